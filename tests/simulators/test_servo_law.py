"""A hobby servo's control law against its equations; what other effects do at a position servo; the load's friction."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Joint, Simulator, TorchSimulator
from onlinebayes.simulators.effects import (
    ActuatorDeadZone,
    ActuatorSaturation,
    BackEmf,
    Effect,
    LoadDependentFriction,
    LoadDependentStribeck,
    QuadraticLoadFriction,
    Scales,
    ServoLaw,
    ThermalDerating,
)
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.stepping import Actuator
from onlinebayes.simulators.testing import check_effect
from tests.simulators.models import ARM, SLIDE

MASS, KP, KV = 2.0, 50.0, 1.5
SERVO = f'<position name="motor" joint="rail" kp="{KP}" kv="{KV}"/>'
STEP = SLIDE.replace('<motor name="motor" joint="rail"/>', SERVO).replace(
    "0.002", "1e-6"
)  # over one of them the gain of velocity is the force at its start
SCALES = Scales(force=1.0, speed=2.0, travel=2.0, time=0.05, unit="slide", output=10.0)
LAW = ServoLaw.scaled("motor", SCALES)
NONE = [10.0, 0.0, 0.0, 0.0]  # limit, back-EMF, dead band, sag


def push(
    simulator: Simulator, theta: list[float], goal: float, q: float = 0.0, v: float = 0.0, on: float = 1.0
) -> float:
    """The force on the mass over one timestep of a microsecond [N]."""

    def row(value: float) -> torch.Tensor:
        return torch.tensor([[value]], dtype=torch.float64)

    state = TensorDict({"qpos": row(q), "qvel": row(v)}, batch_size=[1])
    inputs = TensorDict({"command": row(goal)[..., None], "enable": row(on)[..., None]}, batch_size=[1, 1])
    rows = torch.tensor([theta], dtype=torch.float64).reshape(1, -1)
    after = simulator.rollout(rows, state, inputs, row(simulator.timestep)[0])
    return MASS * (float(after["qvel"][0, 0, 0]) - v) / simulator.timestep


def law(goal: float, q: float, v: float, limit: float, emf: float, band: float, sag: float) -> float:
    e = goal - q
    e = math.copysign(max(abs(e) - band, 0.0), e)
    d = max(-limit, min(KP * e - KV * v, limit))
    return (d - emf * v) / (1 + sag * d * d)


@pytest.mark.parametrize(("goal", "q", "v"), [(0.3, 0.1, 0.5), (-0.4, 0.1, 0.5), (0.11, 0.1, -0.2), (0.1, 0.12, 0.0)])
@pytest.mark.parametrize(
    "theta", [[4.0, 0.0, 0.0, 0.0], [9.0, 2.0, 0.0, 0.0], [9.0, 0.0, 0.03, 0.0], [9.0, 1.0, 0.01, 0.005], NONE]
)
def test_it_is_its_equation(goal: float, q: float, v: float, theta: list[float]) -> None:
    wanted = law(goal, q, v, math.inf if theta == NONE else theta[0], *theta[1:])
    assert push(MujocoSimulator(STEP).with_effect(LAW), theta, goal, q, v) == pytest.approx(wanted, rel=1e-3, abs=1e-4)


def test_the_supply_sags_by_what_the_bridge_draws_from_it() -> None:
    # V = V0 - R_s duty i, i = (duty V - k v) / R, found step by step; d = k V0 duty / R, b = k^2 / R.
    k, resistance, source, supply, duty, v = 0.5, 3.0, 0.8, 7.4, 0.9, 1.2
    volts, current = supply, 0.0
    for _ in range(100):
        current = (duty * volts - k * v) / resistance
        volts = supply - source * duty * current
    assert volts < 0.9 * supply
    d, emf = k * supply * duty / resistance, k * k / resistance
    sag = source * resistance / (k * supply) ** 2
    # Without kv: what is asked is kp e alone.
    servo = MujocoSimulator(STEP.replace(f'kv="{KV}"', "")).with_effect(LAW)
    assert push(servo, [9.0, emf, 0.0, sag], d / KP, 0.0, v) == pytest.approx(k * current, rel=1e-3)


def test_a_servo_that_is_off_is_not_braked_by_its_motor() -> None:
    servo = MujocoSimulator(STEP).with_effect(LAW)
    assert push(servo, [4.0, 2.0, 0.0, 0.0], 0.3, 0.0, 0.5, on=0.0) == 0.0
    assert push(servo, [4.0, 2.0, 0.0, 0.0], 0.3, 0.0, 0.5) == pytest.approx(4.0 - 2.0 * 0.5, rel=1e-3)


def test_limits_of_the_model_stay_and_its_gear_carries_it() -> None:
    geared = STEP.replace('joint="rail" kp', 'joint="rail" gear="3" forcerange="-2 5" kp')
    servo = MujocoSimulator(geared).with_effect(LAW)
    assert push(servo, [4.0, 0.5, 0.0, 0.0], 0.9, 0.0, 0.2) == pytest.approx(3 * (4.0 - 0.5 * 0.2), rel=1e-3)
    assert push(servo, [4.0, 0.5, 0.0, 0.0], -0.9, 0.0, 0.2) == pytest.approx(3 * (-2.0 - 0.5 * 0.2), rel=1e-3)
    # The band is the joint's: kp * gear * w before the gear, and the joint is 0.1 of 0.3 / 3 from its goal.
    assert push(servo, [*NONE[:2], 0.02, 0.0], 0.15, 0.03) == pytest.approx(3 * KP * (0.15 - 3 * 0.05), abs=1e-3)


def test_a_motor_can_have_it_without_a_dead_band() -> None:
    motor = MujocoSimulator(SLIDE.replace("0.002", "1e-6")).with_effect(LAW)
    assert push(motor, [4.0, 0.5, 0.9, 0.0], 6.0, 0.0, 1.0) == pytest.approx(3.5, rel=1e-3)


def test_it_keeps_the_contract() -> None:
    space = ParameterSpace({"actuator.bend.kp": Parameter(1.0, 20.0), "joint.elbow.damping": Parameter(0.0, 1.0)})
    check_effect(MujocoSimulator(ARM, space), ServoLaw.scaled("bend", Scales(1.0, 4.0, 3.0, 0.05, output=6.0)))


@pytest.mark.parametrize("bad", ["limit", "back_emf", "dead_band", "sag"])
def test_bounds_below_zero_are_refused(bad: str) -> None:
    bounds = {name: Parameter(-1.0 if name == bad else 0.0, 1.0) for name in LAW.parameters}
    with pytest.raises(BadInput, match="never negative"):
        ServoLaw("motor", **bounds)


def test_what_the_effects_at_an_actuator_do_to_a_servo() -> None:
    """A dead zone swallows goals, not errors; a limit cuts after the back-EMF, which is kv by another name."""
    zone = MujocoSimulator(STEP).with_effect(ActuatorDeadZone("motor", Parameter(0.0, 1.0)))
    assert push(zone, [0.05], 0.04, 0.2) == pytest.approx(KP * (0.0 - 0.2), rel=1e-3)
    assert push(zone, [0.05], 0.54, 0.5) == pytest.approx(KP * (0.49 - 0.5), rel=1e-3)
    emf = MujocoSimulator(STEP).with_effect(BackEmf("motor", Parameter(0.0, 9.0)))
    more = MujocoSimulator(STEP.replace(f'kv="{KV}"', f'kv="{KV + 2.0}"'))
    assert push(emf, [2.0], 0.1, 0.0, 0.5) == pytest.approx(push(more, [], 0.1, 0.0, 0.5))
    both = emf.with_effect(ActuatorSaturation("motor", Parameter(0.1, 10.0)))
    assert push(both, [2.0, 4.0], 0.9, 0.0, 0.5) == pytest.approx(4.0, rel=1e-3)
    assert push(MujocoSimulator(STEP).with_effect(LAW), [4.0, 2.0, 0.0, 0.0], 0.9, 0.0, 0.5) == pytest.approx(
        3.0, rel=1e-3
    )


@pytest.mark.parametrize(
    ("effect", "theta", "bound"),
    [
        (LoadDependentFriction("rail", Parameter(0, 1)), [0.2], lambda f, v: 0.2 * abs(f)),
        (QuadraticLoadFriction("rail", Parameter(0, 1)), [0.05], lambda f, v: 0.05 * f * f),
        (
            LoadDependentStribeck("rail", Parameter(0, 1), Parameter(0.01, 9.0, scale="log")),
            [0.4, 0.5],
            lambda f, v: 0.4 * abs(f) * math.exp(-((v / 0.5) ** 2)),
        ),
    ],
    ids=lambda x: getattr(x, "name", ""),
)
@pytest.mark.parametrize("v", [0.3, -0.3, 1.5])
def test_frictions_of_the_load(effect: Effect, theta: list[float], bound, v: float) -> None:
    simulator = MujocoSimulator(SLIDE.replace("0.002", "1e-6")).with_effect(effect)
    for f in (5.0, -2.0):
        wanted = f - math.copysign(bound(f, v), v)
        assert push(simulator, theta, f, 0.0, v) == pytest.approx(wanted, rel=1e-2)


def test_the_loads_friction_feels_the_force_that_the_servos_law_leaves() -> None:
    friction = LoadDependentFriction("rail", Parameter(0.0, 1.0))
    # Whichever was added first: 4 N less 1 N of back-EMF, of which .3 rubs.
    for servo, theta in (
        (MujocoSimulator(STEP).with_effect(LAW).with_effect(friction), [4.0, 2.0, 0.0, 0.0, 0.3]),
        (MujocoSimulator(STEP).with_effect(friction).with_effect(LAW), [0.3, 4.0, 2.0, 0.0, 0.0]),
    ):
        assert push(servo, theta, 0.9, 0.0, 0.5) == pytest.approx(3.0 - 0.3 * 3.0, rel=1e-2)


class Slider(TorchSimulator):
    """The slide of ``models.SLIDE`` in torch."""

    physical = ParameterSpace({})
    defaults = {}  # noqa: RUF012
    joints = (Joint("rail", "slide"),)
    actuators = (Actuator("motor", "rail"),)
    timestep = 0.002

    def acceleration(self, parameters, q, v, tau):
        return tau / MASS


def test_both_backends_let_the_loads_friction_feel_a_weakened_motor() -> None:
    heat = ThermalDerating("motor", Parameter(0, 2), Parameter(0.05, 5, "s", scale="log"), 4.0)
    friction, theta = LoadDependentFriction("rail", Parameter(0.0, 1.0)), torch.tensor([[0.2, 0.8, 0.4]]).double()
    command = 5.0 * np.sin(7.0 * 0.002 * np.arange(300))
    paths = []
    for backend in (MujocoSimulator(SLIDE), Slider()):
        simulator = backend.with_effect(friction).with_effect(heat)
        state = TensorDict({k: torch.zeros(1, 1).double() for k in ("qpos", "qvel")}, batch_size=[1])
        inputs = TensorDict({"command": torch.from_numpy(command).reshape(1, -1, 1)}, batch_size=[1, 300])
        times = 0.002 * torch.arange(1, 301, dtype=torch.float64)
        paths.append(simulator.rollout(theta, state, inputs, times)["qpos"])
    torch.testing.assert_close(*paths, rtol=0.0, atol=2e-4)
