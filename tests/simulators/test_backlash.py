"""Backlash: recovered from two masses with stiff stops between them; momentum, rest, limits, an idle actuator."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Backlash
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_effect

H, STEPS, INERTIA, ROTOR, DAMPING, KP, KV = 0.001, 2000, 5.0, 1.5, 6.0, 400.0, 25.0
HINGE = f"""
<mujoco><option timestep="{H}" integrator="implicitfast"/><worldbody><body name="link">
  <joint name="hinge" axis="0 0 1" damping="{DAMPING}"/>
  <inertial pos="0 0 0" mass="1" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
</body></worldbody><actuator>ACTUATOR</actuator></mujoco>"""
MOTOR = HINGE.replace("ACTUATOR", '<motor name="drive" joint="hinge" gear="10"/>')
SERVO = HINGE.replace("ACTUATOR", f'<position name="drive" joint="hinge" kp="{KP}" kv="{KV}"/>')
GAP, BOUND = Parameter(0.0, 0.1, "rad"), Parameter(0.1, 4.0, "kg m2")
TRUE_GAP = 0.03
Law = Callable[[float, float, float], float]


def servo_law(u: float, m: float, w: float) -> float:
    return KP * (u - m) - KV * w


def _inputs(steps: int = STEPS) -> np.ndarray:
    t = H * np.arange(steps)
    return 2.0 * np.sin(7 * t) + 1.2 * np.sign(np.sin(4.3 * t))


def _goals() -> np.ndarray:
    return 0.15 * _inputs()


def stiff(law: Law, u: np.ndarray, gap: float = TRUE_GAP, stops: float = 4e6, parts: int = 50) -> np.ndarray:
    """Angles (T,) of a load; between it and the motor are stops of finite stiffness [N m/rad] that lose all energy."""
    q = v = m = w = 0.0
    h, load, path = H / parts, INERTIA - ROTOR, []
    damper = 2 * np.sqrt(stops * ROTOR * load / INERTIA)
    for command in u:
        for _ in range(parts):
            deep, side = abs(m - q) - gap / 2, math.copysign(1.0, m - q)
            push = side * max(stops * deep + damper * side * (w - v), 0.0) if deep > 0 else 0.0
            v += h * (push - DAMPING * v) / load
            w += h * (law(command, m, w) - push) / ROTOR
            q += h * v
            m += h * w
        path.append(q)
    return np.array(path)


def _rolled(model: str, pairs: list[tuple[float, float]], u: np.ndarray, q: float = 0.0, v: float = 0.0) -> TensorDict:
    """Trajectories, one for each (gap, rotor)."""
    simulator, worlds = MujocoSimulator(model).with_effect(Backlash("hinge", GAP, BOUND)), len(pairs)
    start = TensorDict({"qpos": torch.full((worlds, 1), q), "qvel": torch.full((worlds, 1), v)}, batch_size=[worlds])
    command = torch.from_numpy(u).expand(worlds, -1)[..., None]
    inputs = TensorDict({"command": command}, batch_size=command.shape[:2])
    times = H * torch.arange(1, len(u) + 1, dtype=torch.float64)
    return simulator.rollout(torch.tensor(pairs, dtype=torch.float64), start.double(), inputs, times)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "law", "u"),
    [
        (MOTOR, lambda u, m, w: 10 * u, _inputs()),
        (SERVO, servo_law, _goals()),
    ],
    ids=["motor", "servo"],
)
def test_gap_and_rotor_are_recovered_from_stiff_stops(model: str, law: Law, u: np.ndarray) -> None:
    truth = stiff(law, u)
    gaps, rotors = np.linspace(0.026, 0.034, 9), np.linspace(1.1, 1.9, 9)
    pairs = [(0.0, ROTOR), *itertools.product(gaps.tolist(), rotors.tolist())]
    wrong = np.square(_rolled(model, pairs, u)["qpos"][..., 0].numpy() - truth).sum(1)
    best = pairs[int(wrong.argmin())]
    assert best[0] == pytest.approx(TRUE_GAP, abs=0.0011)
    assert best[1] == pytest.approx(ROTOR, abs=0.21)
    assert wrong.min() < 5e-3 * wrong[0]


@pytest.mark.slow
def test_at_a_stop_both_move_as_one() -> None:
    # A force that never turns round: after the first crossing it is the model without play.
    path = _rolled(MOTOR, [(0.01, ROTOR)], np.full(1000, 3.0))[0]
    contact, speed = path["effects", "backlash@hinge", "contact"].numpy(), path["qvel"][:, 0].numpy()
    first = int((contact > 0).argmax()) + 1  # the rest of the blow comes in the step after
    assert contact[-1] == 1.0
    kept = np.exp(-DAMPING / INERTIA * H * (999 - first))
    assert speed[-1] == pytest.approx(30 / DAMPING + (speed[first] - 30 / DAMPING) * kept, rel=2e-3)


def test_in_its_play_the_joint_feels_nothing() -> None:
    # Thrown at 0.1 rad/s it slows by its own damping alone until it meets the stop, 0.05 rad from the middle.
    path = _rolled(SERVO, [(0.1, ROTOR)], np.zeros(300), v=0.1)[0]
    v = 0.1 * np.exp(-DAMPING / (INERTIA - ROTOR) * H * np.arange(1, 301))
    # The engine treats the servo's kv implicitly: it weighs h kv more on the joint.
    assert path["qvel"][:, 0].numpy() == pytest.approx(v, rel=0.02)


def test_a_blow_keeps_the_momentum() -> None:
    # Nothing but the motor's push: what that put in is the momentum of both, however often they met.
    smooth = MOTOR.replace(f'damping="{DAMPING}"', "")
    pairs = [(0.02, ROTOR), (0.004, 0.5)]
    last = _rolled(smooth, pairs, np.concatenate([np.full(200, 1.5), np.zeros(600)]))[:, -1]
    hidden, v = last["effects", "backlash@hinge"], last["qvel"][:, 0]
    rotor = torch.tensor([rotor for _, rotor in pairs]).double()
    motor = torch.where(hidden["contact"] == 0, hidden["speed"], v)
    momentum = (INERTIA - rotor) * v + rotor * motor
    torch.testing.assert_close(momentum, torch.full((2,), 15.0 * 0.2).double(), rtol=2e-3, atol=0)


@pytest.mark.long
def test_a_load_rests_on_the_stop() -> None:
    # Gravity turns the arm of 0.1 kg m by 0.981 cos q N m; the servo carries it from the other side of its play.
    arm = SERVO.replace('axis="0 0 1"', 'axis="0 1 0"').replace('pos="0 0 0"', 'pos=".1 0 0"')
    arm = arm.replace(f"{INERTIA}", "2.0").replace(f'kp="{KP}"', 'kp="80"')
    q = float(_rolled(arm, [(0.1, 0.5)], np.full(6000, 0.3), q=0.35)["qpos"][0, -1, 0])
    assert 80 * (0.3 - q + 0.05) == pytest.approx(-0.981 * math.cos(q), abs=5e-3)


def test_limits_act_behind_the_play() -> None:
    # Far from its goal the servo is at its limit, gap or none.
    limited = SERVO.replace('kv="25.0"', 'kv="25.0" forcerange="-30 30"')
    far = _rolled(limited, [(0.0, 0.5), (1e-5, 0.5)], np.full(100, 3.0))["qvel"][:, -1, 0]
    assert float(far[1]) == pytest.approx(float(far[0]), rel=0.02)


def test_a_motor_that_is_off_coasts() -> None:
    simulator = MujocoSimulator(SERVO).with_effect(Backlash("hinge", GAP, BOUND))
    start = TensorDict({"qpos": torch.zeros(1, 1), "qvel": torch.full((1, 1), 0.1)}, batch_size=[1]).double()
    off = TensorDict({"command": torch.ones(1, 50, 1), "enable": torch.zeros(1, 50, 1)}, batch_size=[1, 50])
    path = simulator.rollout(torch.tensor([[0.1, ROTOR]]).double(), start, off, H * torch.arange(1, 51).double())[0]
    speed = path["effects", "backlash@hinge", "speed"]
    torch.testing.assert_close(speed, torch.full_like(speed, 0.1))
    coasting = 0.1 * math.exp(-DAMPING / (INERTIA - ROTOR) * 50 * H)
    assert float(path["qvel"][-1, 0]) == pytest.approx(coasting, rel=0.02)


@pytest.mark.parametrize(("model", "scale"), [(MOTOR, 4.0), (SERVO, 0.5)], ids=["motor", "servo"])
def test_conformance(model: str, scale: float) -> None:
    # So narrow that the random commands cross it within the trial.
    check_effect(MujocoSimulator(model), Backlash("hinge", Parameter(0.0, 1e-3, "rad"), BOUND), scale=scale, steps=16)


def test_what_cannot_be() -> None:
    bare = HINGE.replace("<actuator>ACTUATOR</actuator>", "")
    with pytest.raises(BadInput, match="has 0 actuators"):
        MujocoSimulator(bare).with_effect(Backlash("hinge", GAP, BOUND))
    with pytest.raises(BadInput, match="lower bound above 0"):
        Backlash("hinge", GAP, Parameter(0.0, 1.0))
    with pytest.raises(BadInput, match="never negative"):
        Backlash("hinge", Parameter(-0.1, 0.1), BOUND)
