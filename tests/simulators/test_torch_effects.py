"""Effects on torch systems: the contract on every joint and actuator, and what their equations say."""

from __future__ import annotations

import math

import pytest
import torch

from envs.cartpole import CartPole
from envs.pendulum import Pendulum
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import (
    EFFECTS,
    ActuatorDelay,
    AsymmetricFriction,
    ConstantLoad,
    CubicStiffness,
    DryFriction,
    JointStiffness,
    QuadraticDrag,
    Scales,
    ViscousFriction,
)
from onlinebayes.simulators.testing import check_effect
from tests.simulators.systems import CARTPOLE_EFFECTS, FREE, inputs, state_of

SCALES = Scales(force=3.0, speed=2.0, travel=1.0, time=0.1, unit="hinge")
PRIOR = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})


NATIVE_ONLY = (
    *("armature", "payload", "com_offset", "air_drag", "wind", "gravity_tilt", "back_emf"),
    *("contact_friction", "contact_softness", "backlash", "servo_law"),
)
"""Effects that MuJoCo alone carries."""


@pytest.mark.parametrize(
    "name", [n for n, e in EFFECTS.items() if n not in NATIVE_ONLY and e.target_kind != "parameter"]
)
@pytest.mark.parametrize("system", [pytest.param(CartPole, marks=pytest.mark.slow), Pendulum])
def test_contract(system: type, name: str) -> None:
    kind = EFFECTS[name]
    # The pole has no actuator whose force could load it, and a pendulum held by friction shows no parameter.
    driven = {actuator.joint for actuator in system.actuators}
    joints = [joint.name for joint in system.joints if joint.name in driven or not kind.needs_drive]
    targets = {"joint": joints, "actuator": ["motor"], "signal": [f"qpos.{joint}" for joint in joints]}
    for target in targets[kind.target_kind]:
        check_effect(system(PRIOR, dt=2 * system.timestep), kind.scaled(target, SCALES), scale=2.0)


@pytest.mark.parametrize("name", NATIVE_ONLY)
def test_what_torch_cannot_carry_is_refused(name: str) -> None:
    target = {"joint": "hinge", "actuator": "motor", "body": "bob", "geom": "bob", "world": "world"}[
        EFFECTS[name].target_kind
    ]
    with pytest.raises(BadInput, match="no form in torch"):
        Pendulum().with_effect(EFFECTS[name].scaled(target, SCALES))


def test_forces_of_effects_act_as_their_equations_say() -> None:
    # A pendulum without gravity, m l^2 / 3 = 1: one semi-implicit step is v + h tau.
    base = Pendulum(ParameterSpace({"gravity": Parameter(0, 10)}))
    v, q, h = 2.0, 0.3, 0.05
    cases = [
        (ViscousFriction("hinge", Parameter(0, 1)), {"damping": 0.5}, -0.5 * v),
        (QuadraticDrag("hinge", Parameter(0, 1)), {"drag": 0.5}, -0.5 * v * v),
        (ConstantLoad("hinge", Parameter(-1, 1)), {"load": -0.7}, -0.7),
        (JointStiffness("hinge", Parameter(0, 5), Parameter(-1, 1)), {"stiffness": 4.0, "springref": 0.1}, -4 * 0.2),
        (DryFriction("hinge", Parameter(0, 1)), {"frictionloss": 0.6}, -0.6),
        (
            CubicStiffness("hinge", Parameter(0, 5), Parameter(-1, 1)),
            {"stiffness3": 4.0, "springref": -0.2},
            -4 * 0.5**3,
        ),
        (
            AsymmetricFriction("hinge", Parameter(0, 1), Parameter(0, 1)),
            {"frictionloss_positive": 0.6, "frictionloss_negative": 0.2},
            -0.6,
        ),
    ]
    for effect, values, torque in cases:
        simulator = base.with_effect(effect)
        own = {f"{effect.key}.{name}": value for name, value in values.items()}
        theta = simulator.parameters.vector({"gravity": 0.0, **own})[None]
        simulator.reset(theta, state_of([[q]], [[v]]))
        after = simulator.step(inputs(torch.zeros(1, 1)))
        torch.testing.assert_close(
            after["qvel"], torch.tensor([[v + 3 * h * torque]], dtype=torch.float64), rtol=1e-12, atol=0
        )


def test_a_stuck_joint_stays_exactly_at_rest_until_breakaway() -> None:
    # Gravity's torque at angle phi is m g l / 2 sin(phi), here 5 sin(0.2) = 0.993 N m.
    simulator = Pendulum((), 3).with_effect(DryFriction("hinge", Parameter(0, 5, "N m")))
    load = 5 * math.sin(0.2)
    theta = torch.tensor([[1.001 * load], [0.999 * load], [5.0]], dtype=torch.float64)
    simulator.reset(theta, state_of([[0.2]] * 3, [[0.0]] * 3))
    for _ in range(500):
        after = simulator.step(inputs(torch.zeros(3, 1)))
    assert after["qpos"][0].item() == 0.2
    assert after["qvel"][0].item() == 0.0
    assert after["qpos"][1].item() > 1.0
    # The third comes to rest from motion, in finite time, and then stays.
    simulator.reset(theta, state_of([[0.2]] * 3, [[3.0]] * 3))
    rows = [simulator.step(inputs(torch.zeros(3, 1)))["qpos"][2].item() for _ in range(40)]
    assert rows[-1] == rows[20] > 0.2


def test_a_delay_shifts_commands_within_dt() -> None:
    simulator = CartPole((), 1, dt=0.08).with_effect(ActuatorDelay("motor", Parameter(0, 0.2, "s")))
    plain = CartPole((), 1)
    commands = torch.randn(1, 10, 1, dtype=torch.float64).clamp(-1, 1)
    # A delay of 3 timesteps of 0.02 s is a shift of the fine staircase of commands by three.
    fine = torch.cat((torch.zeros(1, 3, 1), commands.repeat_interleave(4, dim=1)), dim=1)[:, :40]
    shifted = plain.rollout(plain.nominal[None], plain.state, inputs(fine), 0.02 * torch.arange(1, 41))
    theta = torch.tensor([[0.06]], dtype=torch.float64)
    delayed = simulator.rollout(theta, simulator.state, inputs(commands), 0.08 * torch.arange(1, 11))
    torch.testing.assert_close(delayed["qpos"], shifted["qpos"][:, 3::4], rtol=1e-12, atol=1e-14)


def test_effects_grow_the_space_and_wrong_ones_are_refused() -> None:
    simulator = CartPole(FREE).with_effect(CARTPOLE_EFFECTS[1])
    assert simulator.parameters.names == ("length", "mass", "dry_friction@cart.frictionloss")
    assert simulator.nominal.tolist() == [0.5, 0.1, 0.0]
    assert CartPole(FREE).effects == ()
    with pytest.raises(BadInput, match="joint 'card' of dry_friction@card is unknown; nearest: cart"):
        simulator.with_effect(DryFriction("card", Parameter(0, 1)))
    with pytest.raises(BadInput, match="dry_friction@cart is already part"):
        simulator.with_effect(DryFriction("cart", Parameter(0, 1)))
