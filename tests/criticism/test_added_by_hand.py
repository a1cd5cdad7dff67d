"""Effects that a user added by hand are fitted from wherever their bounds begin."""

from __future__ import annotations

import pytest

from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorSaturation, DryFriction, Effect, JointStiffness
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import TRUTH, measure, model

SATURATION = ActuatorSaturation("motor", Parameter(0.1, 30.0, "N"))  # the commands stay below 12
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
SPRING = JointStiffness("rail", Parameter(0.0, 20.0, "N/m"), Parameter(-3.0, 3.0, "m"))


def values_of(simulator: MujocoSimulator, hidden: dict[Effect, tuple[float, ...]], runs: int) -> list[float]:
    """Theta of the base model."""
    return list(start_search(simulator, measure(hidden, runs=runs, finer=2)).base.values.values())


@pytest.mark.slow
def test_a_limit_is_found_from_out_of_reach() -> None:
    found = values_of(model().with_effect(SATURATION), {SATURATION: (4.0,)}, 3)
    assert found == pytest.approx([*TRUTH, 4.0], rel=0.02)


@pytest.mark.slow
def test_a_spring_beside_friction_is_recovered() -> None:
    rig = model().with_effect(FRICTION).with_effect(SPRING)
    found = values_of(rig, {FRICTION: (0.8,), SPRING: (3.0, 0.4)}, 4)
    assert found == pytest.approx([*TRUTH, 0.8, 3.0, 0.4], rel=0.02)
