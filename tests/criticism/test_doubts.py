"""What the held-out runs contradict is not said to be the explanation."""

from __future__ import annotations

from dataclasses import replace

import pytest

from onlinebayes.criticism import refine
from onlinebayes.parameters import Parameter
from onlinebayes.report.words import headline
from onlinebayes.simulators.effects import ConstantLoad
from tests.criticism.rigs import measure, model

LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))


@pytest.mark.slow
def test_a_law_that_does_not_carry_over_to_the_held_out_runs_is_doubted() -> None:
    measured, other = measure({LOAD: (0.5,)}, runs=10), measure(runs=10)
    held = [measured.runs.index(run) for run in ("run8", "run9")]
    data = measured.data.clone()
    data[held] = other.data[held]  # nobody pushes in these
    result = refine(model(), replace(measured, data=data), holdout=("run8", "run9"), candidates=("constant_load",))
    assert result.accepted == ()
    assert result.contradicted == ("constant_load@rail",)
    assert result.final is result.base
    assert result.verdict == "unexplained"
    assert "fits the runs it was fitted to, and not the held-out ones" in headline(result)
    assert "constant_load@rail fits the runs that it was fitted to and makes the held-out runs worse" in result.notes[0]
    (row,) = [one for one in result.candidates if one.effect == "constant_load@rail"]
    assert row.refused_because == ("the held-out error rises with it",)
