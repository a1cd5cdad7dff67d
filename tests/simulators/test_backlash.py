"""Backlash: recovered from a two-sided model with stiff stops; at rest, in its play and at the servo's limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Backlash
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_effect
from tests.simulators.models import ARM, SLIDE

H, STEPS, KP, KV, INERTIA, DAMPING = 0.001, 1200, 8.0, 0.4, 0.05, 0.1
SERVO = f"""
<mujoco><option timestep="{H}" integrator="implicitfast"/><worldbody><body name="link">
  <joint name="hinge" axis="0 0 1" damping="{DAMPING}"/>
  <inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
</body></worldbody><actuator><position name="servo" joint="hinge" kp="{KP}" kv="{KV}"/></actuator></mujoco>"""
GAP = Parameter(0.0, 0.5, "rad")


def _goals(steps: int = STEPS) -> np.ndarray:
    t = H * np.arange(steps)
    return 0.5 * np.sin(5 * t) + 0.3 * np.sign(np.sin(3.1 * t))


def _stiff(gap: float, goals: np.ndarray, stops: float = 1e6, parts: int = 50) -> np.ndarray:
    """Angles (T,) of a load and a massless motor with stops of finite stiffness [N m/rad] between them."""
    q = v = m = 0.0
    h, path = H / parts, []
    for u in goals:
        for _ in range(parts):
            # The motor's side is stiff: implicit in m, on the side of the stop where it ends up.
            free = (KV * m / h + KP * u) / (KV / h + KP)
            edge = q + math.copysign(gap / 2, free - q)
            if abs(free - q) > gap / 2:
                m = (KV * m / h + KP * u + stops * edge) / (KV / h + KP + stops)
                torque = stops * (m - edge)
            else:
                m, torque = free, 0.0
            v += h * (torque - DAMPING * v) / INERTIA
            q += h * v
        path.append(q)
    return np.array(path)


def _rolled(gaps: list[float], goals: np.ndarray, model: str = SERVO, q: float = 0.0, v: float = 0.0) -> TensorDict:
    """Trajectories, one a gap."""
    simulator, worlds = MujocoSimulator(model).with_effect(Backlash("hinge", GAP)), len(gaps)
    position, velocity = (torch.full((worlds, 1), x, dtype=torch.float64) for x in (q, v))
    start = TensorDict({"qpos": position, "qvel": velocity}, batch_size=[worlds])
    times = H * torch.arange(1, len(goals) + 1, dtype=torch.float64)
    command = torch.from_numpy(goals).expand(worlds, -1)[..., None]
    inputs = TensorDict({"command": command}, batch_size=command.shape[:2])
    return simulator.rollout(torch.tensor(gaps, dtype=torch.float64)[:, None], start, inputs, times)


def test_the_gap_is_recovered_from_stiff_stops() -> None:
    goals, gaps = _goals(), [0.0, *(0.12 + 0.002 * k for k in range(-8, 9))]
    wrong = np.square(_rolled(gaps, goals)["qpos"][..., 0].numpy() - _stiff(0.12, goals)).sum(1)
    near = np.polynomial.Polynomial.fit(gaps[1:], wrong[1:], 2)
    assert near.deriv().roots()[0] == pytest.approx(0.12, rel=0.02)
    assert wrong.min() < 1e-3 * wrong[0]


def test_in_its_play_the_joint_feels_nothing() -> None:
    # Thrown at 0.1 rad/s it slows by its own damping alone until it meets the stop, 0.1 rad from the middle.
    path = _rolled([0.2], np.zeros(400), v=0.1)[0]
    v = 0.1 * np.exp(-DAMPING / INERTIA * H * np.arange(1, 401))
    # The engine treats the servo's kv implicitly: it weighs h kv more on the joint.
    assert path["qvel"][:, 0].numpy() == pytest.approx(v, rel=0.02)
    offset = path["effects", "backlash@hinge", "offset"].numpy()
    assert offset[-1] == pytest.approx(-float(path["qpos"][-1, 0]), rel=0.05)


def test_a_load_rests_on_the_stop() -> None:
    # Gravity turns the arm of 0.1 kg m by 0.981 cos q N m; the servo carries it from the other side of its play.
    arm = SERVO.replace('axis="0 0 1"', 'axis="0 1 0"').replace('pos="0 0 0"', 'pos=".1 0 0"')
    q = float(_rolled([0.1], np.full(STEPS, 0.3), arm, q=0.45)["qpos"][0, -1, 0])
    assert KP * (0.3 - q + 0.05) == pytest.approx(-0.981 * math.cos(q), abs=1e-3)


def test_limits_act_behind_the_play() -> None:
    # Far from its goal the servo is at its limit, gap or none.
    limited = SERVO.replace('kv="0.4"', 'kv="0.4" forcerange="-1 1"')
    far = _rolled([0.0, 1e-4], np.full(50, 3.0), limited)["qvel"][:, -1, 0]
    assert float(far[1]) == pytest.approx(float(far[0]), rel=0.02)


def test_a_motor_that_is_off_stays_where_it_is() -> None:
    simulator = MujocoSimulator(SERVO).with_effect(Backlash("hinge", GAP))
    start = TensorDict({"qpos": torch.zeros(1, 1), "qvel": torch.full((1, 1), 0.1)}, batch_size=[1]).double()
    off = TensorDict({"command": torch.ones(1, 50, 1), "enable": torch.zeros(1, 50, 1)}, batch_size=[1, 50])
    path = simulator.rollout(torch.tensor([[0.2]]).double(), start, off, H * torch.arange(1, 51).double())[0]
    motor = path["qpos"][:, 0] + path["effects", "backlash@hinge", "offset"]
    assert motor.abs().max() < 1e-5
    assert float(path["qvel"][-1, 0]) == pytest.approx(0.1 * math.exp(-DAMPING / INERTIA * 50 * H), rel=0.02)


def test_conformance_with_a_fast_servo() -> None:
    # Without kv the motor is at its goal at once.
    check_effect(MujocoSimulator(SERVO.replace(f'kv="{KV}"', 'kv="0"')), Backlash("hinge", GAP), scale=0.5, steps=8)


def test_only_servos_have_play() -> None:
    with pytest.raises(BadInput, match="no position servo"):
        MujocoSimulator(SLIDE).with_effect(Backlash("rail", GAP))
    bare = ARM.replace('<position name="bend" joint="elbow" kp="8" kv="0.6" forcerange="-6 6"/>', "")
    with pytest.raises(BadInput, match="has 0 actuators"):
        MujocoSimulator(bare).with_effect(Backlash("elbow", GAP))
    with pytest.raises(BadInput, match="never negative"):
        Backlash("hinge", Parameter(-0.1, 0.1))
