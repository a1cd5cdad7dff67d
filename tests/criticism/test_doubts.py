"""What the held-out runs contradict is not said to be the explanation."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from onlinebayes.criticism import refine
from onlinebayes.criticism.findings.doubts import held_out_gain
from onlinebayes.criticism.results import HeldOutError
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


def test_the_held_out_gain_is_that_of_the_score() -> None:
    floor, horizon = {"a": 2.0, "b": 1.0}, {"a": 1.0, "b": 1.0}
    error = HeldOutError({"a": 6.0, "b": 5.0}, {"a": 2.0, "b": 5.0}, floor, horizon)
    assert held_out_gain(error) == pytest.approx(0.5 * math.log(10 / 2))
    diverged = replace(error, after={"a": math.inf, "b": 5.0})
    assert held_out_gain(diverged) == -math.inf
    assert math.isnan(held_out_gain(replace(error, before={"a": math.nan, "b": math.nan})))
