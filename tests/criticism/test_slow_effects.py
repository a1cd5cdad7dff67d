"""What is too slow to show within a second: a free swing with a drag that its start takes up in every short window."""

from __future__ import annotations

import numpy as np
import pytest

from onlinebayes.criticism import Selection, refine
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = """
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body name="bob"><joint name="hinge" axis="0 1 0"/>
  <geom type="sphere" size="0.03" pos="0 0 -0.4" mass="0.5"/></body></worldbody></mujoco>"""
MASS, LENGTH, RADIUS, ROTOR, DAMPING, DRAG = 0.5, 0.4, 0.03, 0.002, 0.002, 0.0008
SD = 0.01  # [rad]


def swings(drag: float, seconds: float, runs: int = 10) -> Measurement:
    """I q'' = -m g l sin q - d q' - k q' |q'| of a released pendulum by RK4 at 1 ms, a noisy angle every 10 ms."""
    inertia = MASS * LENGTH**2 + 0.4 * MASS * RADIUS**2 + ROTOR
    draw = np.random.default_rng(0)

    def slope(state: np.ndarray) -> np.ndarray:
        q, v = state
        return np.stack([v, -(MASS * 9.81 * LENGTH * np.sin(q) + DAMPING * v + drag * v * np.abs(v)) / inertia])

    h, state = 1e-3, np.stack([draw.uniform(0.4, 2.4, runs) * draw.choice([-1.0, 1.0], runs), np.zeros(runs)])
    angles = []
    for k in range(round(seconds / h)):
        if k % 10 == 0:
            angles.append(state[0])
        a = slope(state)
        b = slope(state + h / 2 * a)
        c = slope(state + h / 2 * b)
        state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c))
    shown = np.stack(angles) + SD * draw.standard_normal((len(angles), runs))
    time = 0.01 * np.arange(len(angles))
    return Measurement.from_runs(
        {f"run{r}": {"time": time, "qpos.hinge": shown[:, r]} for r in range(runs)},
        [Signal("qpos.hinge", "rad")],
        commands=[],
    )


def model() -> MujocoSimulator:
    free = {"joint.hinge.damping": Parameter(0.0, 0.02), "joint.hinge.armature": Parameter(0.0, 0.02)}
    return MujocoSimulator(MODEL, ParameterSpace(free), threads=1)


@pytest.mark.long
def test_a_drag_that_a_second_hides_is_found_over_longer_windows() -> None:
    result = refine(model(), swings(DRAG, 20.0), holdout=["run8", "run9"])
    assert (result.verdict, result.accepted) == ("missing_effect", ("quadratic_drag@hinge",))
    found = next(c for c in result.candidates if c.accepted).parameters["drag"]
    assert abs(found.mean - DRAG) < 3 * found.sd < 0.3 * DRAG
    assert result.remainder.status == "noise"


@pytest.mark.slow
def test_a_horizon_that_was_asked_for_stands() -> None:
    result = refine(
        model(),
        swings(DRAG, 6.0),
        holdout=["run8", "run9"],
        selection=Selection(fixed_horizon=True),
        candidates=["quadratic_drag"],
    )
    assert result.heldout_error.horizon_s == {"qpos.hinge": 1.0}
