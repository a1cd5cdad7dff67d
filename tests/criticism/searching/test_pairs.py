"""Two effects missing at once of which neither may be added alone."""

from __future__ import annotations

from dataclasses import replace

import pytest

from onlinebayes.criticism import Selection, refine
from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.pairs import find_pair
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import run_stage
from onlinebayes.parameters import Parameter
from onlinebayes.runs import Interrupt, Watch
from onlinebayes.simulators.effects import ActuatorDelay, ConstantLoad, Effect, JointStiffness
from tests.criticism.rigs import measure, model

SPRING = JointStiffness("rail", Parameter(0.0, 5.0, "N/m"), Parameter(-5.0, 5.0, "m"))
LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
FEW = ["constant_load", "joint_stiffness", "dry_friction", "quadratic_drag", "actuator_gain", "actuator_delay"]
DELAY = ActuatorDelay("motor", Parameter(0.0, 0.1, "s"))


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        pytest.param(SPRING, (0.4, 0.5), marks=pytest.mark.slow),
        pytest.param(LOAD, (0.4,), marks=pytest.mark.long),
    ],
)
def test_a_force_and_a_delay_hide_each_other(effect: Effect, values: tuple[float, ...]) -> None:
    hidden = measure({effect: values, DELAY: (0.02,)}, runs=10)
    selection = Selection()
    base = ground(model(), hidden, selection)
    effects = propose(base.fitted.simulator, base.windows, FEW)
    stage = run_stage(base.fitted, base.windows, effects, base.numerics, selection)
    assert not any(judged.admissible for judged in stage.judged)
    context = SearchContext(hidden, selection)
    found = find_pair(stage, effects, base.numerics, context)
    assert found is not None
    assert {judged.effect.key for _, judged in found} == {effect.key, DELAY.key}
    stopped = Interrupt()
    stopped.requested = True
    assert find_pair(stage, effects, base.numerics, replace(context, watch=Watch(interrupt=stopped))) is None
    result = refine(model(), hidden, holdout=["run9", "run8"], candidates=FEW)
    assert result.verdict == "missing_effect"
    assert set(result.accepted) == {effect.key, DELAY.key}
    first, second = (next(c for c in result.candidates if c.effect == key) for key in result.accepted)
    assert (first.accepted_with, second.accepted_with) == ((second.effect,), ())
    assert result.remainder.status == "noise"
    delay = result.parameters["actuator_delay@motor.delay"]
    assert delay.mean == pytest.approx(0.02, abs=5 * delay.sd)
