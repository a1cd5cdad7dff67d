"""Effects recover their parameters from data that plain MuJoCo, its fields set by hand, or a formula has made."""

from __future__ import annotations

import math
from collections.abc import Callable

import mujoco
import numpy as np
import pytest
import torch
from scipy.optimize import least_squares
from tensordict import TensorDict

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import (
    ActuatorDeadZone,
    ActuatorLag,
    ActuatorSaturation,
    Armature,
    AsymmetricFriction,
    BackEmf,
    ComOffset,
    ConstantLoad,
    CubicStiffness,
    DryFriction,
    Effect,
    GravityTilt,
    Payload,
)
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_effect
from tests.simulators.models import ARM, SLIDE

H, STEPS = 0.004, 300
LINK = f"""
<mujoco><option timestep="{H}" integrator="RK4"/><worldbody>
  <body name="link"><joint name="hinge" axis="0 1 0" damping=".05"/>
    <inertial pos="0 0 -.4" mass="1.2" diaginertia=".02 .02 .004"/>
    <body name="tip" pos="0 0 -.8"><inertial pos="0 0 -.1" mass=".1" diaginertia="1e-3 1e-3 1e-3"/></body></body>
</worldbody><actuator><motor name="motor" joint="hinge" gear="2"/></actuator></mujoco>"""
"""A pendulum with a motor."""


def _commands(seed: int = 0) -> np.ndarray:
    t = H * np.arange(STEPS)
    return 2.5 * np.sin(6.0 * t + seed) + 1.5 * np.sin(17.0 * t)


def _plain(change: Callable[[mujoco.MjModel], None], command: np.ndarray) -> np.ndarray:
    """Angles (T,) of plain MuJoCo's loop over a model whose fields were changed."""
    model = mujoco.MjModel.from_xml_string(LINK)
    change(model)
    mujoco.mj_setConst(model, mujoco.MjData(model))  # on data of its own, which it leaves at the springs' rest
    data, path = mujoco.MjData(model), []
    for u in command:
        data.ctrl[0] = u
        mujoco.mj_step(model, data)
        path.append(data.qpos[0])
    return np.array(path)


def _rolled(simulator: MujocoSimulator, theta: np.ndarray, command: np.ndarray) -> np.ndarray:
    times = simulator.timestep * torch.arange(1, len(command) + 1, dtype=torch.float64)
    inputs = TensorDict({"command": torch.from_numpy(command)[None, :, None]}, batch_size=[1, len(command)])
    start = simulator.with_worlds(1).state
    return simulator.rollout(torch.from_numpy(theta)[None], start, inputs, times)["qpos"][0, :, 0].numpy()


def _recovered(effect: Effect, path: np.ndarray, command: np.ndarray, model: str = LINK) -> dict[str, float]:
    """The parameters that fit the path best, from the middle of their bounds."""
    simulator = MujocoSimulator(model).with_effect(effect)
    low, high = simulator.parameters.low.numpy(), simulator.parameters.high.numpy()

    def wrong(u: np.ndarray) -> np.ndarray:
        return (_rolled(simulator, low + u * (high - low), command) - path) * 1e3

    found = least_squares(wrong, np.full(len(low), 0.4), bounds=(0, 1), xtol=1e-12, ftol=1e-12, diff_step=1e-6)
    return dict(zip(effect.parameters, (low + found.x * (high - low)).tolist(), strict=True))


def _armature(model: mujoco.MjModel) -> None:
    model.dof_armature[0] = 0.07


def _payload(model: mujoco.MjModel) -> None:
    model.body_mass[2] += 0.3


def _offset(model: mujoco.MjModel) -> None:
    model.body_ipos[1, 0] += 0.05


def _tilt(model: mujoco.MjModel) -> None:
    model.opt.gravity[:] = (9.81 * math.sin(0.1), 0.0, -9.81 * math.cos(0.1))


def _spring(model: mujoco.MjModel) -> None:
    # The joint has no spring of its own, so that its cubic term may stand for the effect's.
    model.jnt_stiffnesspoly[0, 1], model.qpos_spring[0] = 3.0, 0.2


def _limit(model: mujoco.MjModel) -> None:
    model.actuator_forcelimited[0], model.actuator_forcerange[0] = 1, (-1.7, 1.7)


def _damp(model: mujoco.MjModel) -> None:
    model.dof_damping[0] += 4 * 0.06  # gear^2 k


@pytest.mark.parametrize(
    ("effect", "change", "truth"),
    [
        (Armature("hinge", Parameter(0.0, 0.2)), _armature, {"armature": 0.07}),
        (Payload("tip", Parameter(0.0, 1.0)), _payload, {"mass": 0.3}),
        (ComOffset("link.x", x=Parameter(-0.1, 0.1)), _offset, {"x": 0.05}),
        (GravityTilt("world.x", Parameter(-0.3, 0.3)), _tilt, {"angle": 0.1}),
        (
            CubicStiffness("hinge", Parameter(0.0, 9.0), Parameter(-0.5, 0.5)),
            _spring,
            {"stiffness3": 3.0, "springref": 0.2},
        ),
        (ActuatorSaturation("motor", Parameter(0.1, 4.0)), _limit, {"limit": 1.7}),
        (BackEmf("motor", Parameter(0.0, 0.3)), _damp, {"constant": 0.06}),
    ],
    ids=lambda x: getattr(x, "key", ""),
)
def test_fields_set_by_hand_are_recovered(effect: Effect, change, truth: dict[str, float]) -> None:
    command = _commands()
    found = _recovered(effect, _plain(change, command), command)
    assert found == pytest.approx(truth, rel=1e-5)


def test_a_lag_is_recovered_from_the_exact_response() -> None:
    # A free mass of 2 kg under the exact response of T du'/dt = u - u' to the staircase, a hundred points a timestep.
    T, h, fine = 0.03, 0.002, 100
    command = np.repeat(np.random.default_rng(0).normal(size=30), 5)
    lagged, v, path = 0.0, 0.0, []
    for u in command:
        for _ in range(fine):
            after = u + (lagged - u) * math.exp(-h / fine / T)
            v += h / fine * (lagged + after) / 2 / 2.0
            lagged = after
        path.append(v)
    # MuJoCo's Euler moves the position by the new velocity.
    found = _recovered(ActuatorLag("motor", Parameter(0.0, 0.1)), h * np.cumsum(path), command, SLIDE)
    assert found["time_constant"] == pytest.approx(T, rel=1e-5)


def test_a_lags_hidden_state_continues_across_steps() -> None:
    simulator = MujocoSimulator(SLIDE, dt=0.006).with_effect(ActuatorLag("motor", Parameter(0.0, 0.1)))
    simulator.reset(torch.tensor([[0.02]], dtype=torch.float64))
    for _ in range(3):
        state = simulator.step(TensorDict({"command": torch.ones(1, 1)}, batch_size=[1]))
    lagged = state["effects", "actuator_lag@motor", "lagged"]
    assert float(lagged) == pytest.approx(1 - math.exp(-0.018 / 0.02), rel=1e-12)


def test_a_dead_zone_is_recovered() -> None:
    command = _commands()
    swallowed = np.sign(command) * np.maximum(np.abs(command) - 0.6, 0.0)
    found = _recovered(ActuatorDeadZone("motor", Parameter(0.0, 2.0)), _plain(lambda model: None, swallowed), command)
    assert found["width"] == pytest.approx(0.6, rel=1e-5)


def test_asymmetric_friction_slides_and_sticks_by_its_law() -> None:
    effect = AsymmetricFriction("rail", Parameter(0.0, 5.0), Parameter(0.0, 5.0))
    simulator = MujocoSimulator(SLIDE).with_effect(effect)
    theta, h, mass = np.array([3.0, 1.0]), 0.002, 2.0
    for push, force in ((5.0, 5.0 - 3.0), (-5.0, -5.0 + 1.0), (2.9, 0.0), (-0.9, 0.0)):
        path = _rolled(simulator, theta, np.full(200, push))
        assert path[-1] == pytest.approx(force / mass * h * h * 200 * 201 / 2, rel=1e-4, abs=1e-6)


def test_asymmetric_friction_is_dry_friction_and_a_load() -> None:
    command = _commands()
    both = (
        MujocoSimulator(LINK)
        .with_effect(DryFriction("hinge", Parameter(0, 5)))
        .with_effect(ConstantLoad("hinge", Parameter(-5, 5)))
    )
    one = MujocoSimulator(LINK).with_effect(AsymmetricFriction("hinge", Parameter(0, 5), Parameter(0, 5)))
    path = _rolled(both, np.array([0.75, -0.25]), command)
    assert np.array_equal(path, _rolled(one, np.array([1.0, 0.5]), command))


def test_a_limit_at_its_upper_bound_is_none() -> None:
    simulator = MujocoSimulator(LINK).with_effect(ActuatorSaturation("motor", Parameter(0.0, 1.0)))
    command = _commands()
    assert np.array_equal(_rolled(simulator, np.array([1.0]), command), _plain(lambda model: None, command))
    assert not np.allclose(_rolled(simulator, np.array([0.99]), command), _plain(lambda model: None, command))


def test_a_limit_cuts_within_the_models_own() -> None:
    own = MujocoSimulator(LINK.replace("<motor ", '<motor forcerange="-1 .5" '))
    simulator = own.with_effect(ActuatorSaturation("motor", Parameter(0.0, 9.0)))
    assert simulator.fields(np.array([[0.8]]))["actuator_forcerange"].tolist() == [[[-0.8, 0.5]]]
    assert simulator.fields(np.array([[9.0]]))["actuator_forcerange"].tolist() == [[[-1.0, 0.5]]]


def test_a_tilt_points_downhill() -> None:
    simulator = MujocoSimulator(LINK).with_effect(
        GravityTilt("world", Parameter(0.0, 0.5), Parameter(-math.pi, math.pi))
    )
    a, d = 0.3, 2.0
    g = simulator.fields(np.array([[a, d]]))["opt.gravity"][0]
    downhill = [math.sin(a) * math.cos(d), math.sin(a) * math.sin(d), -math.cos(a)]
    assert g == pytest.approx(9.81 * np.array(downhill), abs=1e-12)


@pytest.mark.parametrize(
    "effect",
    [
        ComOffset("fore.z", z=Parameter(-0.1, 0.1)),
        GravityTilt("world.x", Parameter(-0.3, 0.3)),
        BackEmf("lift", Parameter(0.0, 0.5)),
        ActuatorSaturation("lift", Parameter(0.0, 0.9)),
    ],
    ids=lambda e: e.key,
)
def test_conformance_of_variants(effect: Effect) -> None:
    check_effect(MujocoSimulator(ARM), effect)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Armature("j", Parameter(-1.0, 1.0)), "never negative"),
        (lambda: CubicStiffness("j", Parameter(-1.0, 1.0), Parameter(-1.0, 1.0)), "never negative"),
        (lambda: AsymmetricFriction("j", Parameter(0.0, 1.0), Parameter(-1.0, 1.0)), "never negative"),
        (lambda: ActuatorSaturation("a", Parameter(-1.0, 1.0)), "never negative"),
        (lambda: ComOffset("b.x", y=Parameter(-1.0, 1.0)), "does not fit the target"),
        (lambda: GravityTilt("world", Parameter(-1.0, 1.0)), "does not fit the target"),
        (lambda: MujocoSimulator(LINK).with_effect(Payload("tap", Parameter(0.0, 1.0))), "nearest: tip"),
        (lambda: MujocoSimulator(LINK).with_effect(Payload("world", Parameter(0.0, 1.0))), "fixed to the world"),
        (lambda: MujocoSimulator(LINK).with_effect(GravityTilt("moon.x", Parameter(-0.1, 0.1))), "@world"),
    ],
)
def test_what_makes_no_sense_is_refused(make, says: str) -> None:
    with pytest.raises(BadInput, match=says):
        make()
