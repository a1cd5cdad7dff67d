"""What the held-out runs contradict is not said to be the explanation."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from onlinebayes.criticism import refine
from onlinebayes.criticism.findings.doubts import doubts
from onlinebayes.parameters import Parameter
from onlinebayes.report.words import headline
from onlinebayes.simulators.effects import ConstantLoad
from tests.criticism.rigs import explain, measure, model

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


def test_what_gains_too_little_on_the_held_out_runs_is_doubted() -> None:
    explanation = explain(model(), measure({LOAD: (0.5,)}, runs=6), ["run5"], ["constant_load"])
    assert explanation.found.hypothesis.keys == ("constant_load@rail",)
    (said,) = doubts(explanation, 0.04)
    assert "the held-out error does not fall with constant_load@rail" in said
    assert not [*doubts(explanation, 0.06)]
    assert not [*doubts(explanation, math.nan)]


@pytest.mark.slow
def test_what_stays_gains_what_the_held_out_runs_say() -> None:
    measured = measure({LOAD: (0.5,)}, runs=6)
    found = refine(model(), measured, holdout=["run5"], candidates=["constant_load"])
    before, after = (one["qpos.rail"] / 1e-4 for one in (found.heldout_error.before, found.heldout_error.after))
    assert found.held_out_gain > 0.5 * math.log((1 + before**2) / (1 + after**2))  # averages have less noise than rows
    assert not found.contradicted
