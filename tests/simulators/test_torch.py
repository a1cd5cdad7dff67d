"""Torch systems: one world like many, steps like a rollout, effects as physics says, failures that stay alone."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from envs.cartpole import CartPole
from envs.pendulum import Pendulum
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import TorchSimulator
from onlinebayes.simulators.effects import (
    ActuatorDelay,
    ActuatorGain,
    ConstantLoad,
    DryFriction,
    Effect,
    JointStiffness,
    QuadraticDrag,
    ViscousFriction,
)

FREE = ["length", "mass"]
CARTPOLE_EFFECTS: list[Effect] = [
    ViscousFriction("cart", Parameter(0, 10, "N s/m")),
    DryFriction("cart", Parameter(0, 10, "N")),
    QuadraticDrag("pole", Parameter(0, 10)),
    JointStiffness("pole", Parameter(0, 10), Parameter(-1, 1)),
    ConstantLoad("cart", Parameter(-10, 10, "N")),
    ActuatorGain("motor", Parameter(-0.5, 1)),
    ActuatorDelay("motor", Parameter(0, 0.1, "s")),
]


@pytest.mark.parametrize("system", [CartPole, Pendulum])
def test_a_world_does_not_depend_on_the_others(system: type[TorchSimulator]) -> None:
    simulator = _all_effects(system, worlds=7)
    theta, state, commands = _random(simulator, 7, 20)
    simulator.reset(theta, state)
    together = [simulator.step(_inputs(u)) for u in commands.unbind(1)]
    for i in (0, 6):
        alone = simulator.with_worlds(1)
        alone.reset(theta[i : i + 1], state[i : i + 1])
        for k, u in enumerate(commands[i : i + 1].unbind(1)):
            row = alone.step(_inputs(u))
            assert torch.equal(row["qpos"], together[k]["qpos"][i : i + 1])
            assert torch.equal(row["qvel"], together[k]["qvel"][i : i + 1])


@pytest.mark.parametrize("system", [CartPole, Pendulum])
def test_a_rollout_equals_steps_and_leaves_the_worlds_alone(system: type[TorchSimulator]) -> None:
    simulator = _all_effects(system, worlds=3, steps_per_dt=4)
    theta, state, commands = _random(simulator, 3, 15)
    times = simulator.dt * torch.arange(1, 16, dtype=torch.float64)
    untouched = simulator.state
    trajectory = simulator.rollout(theta, state, _inputs(commands), times)
    assert (simulator.state == untouched).all()
    simulator.reset(theta, state)
    for k, u in enumerate(commands.unbind(1)):
        after = simulator.step(_inputs(u))
        assert (after == trajectory.exclude("valid")[:, k]).all()
    assert trajectory["valid"].all()


def test_a_rollout_takes_rows_at_uneven_times_and_held_commands() -> None:
    simulator = CartPole(FREE)
    theta, state, commands = _random(simulator, 5, 3)
    dense = commands.repeat_interleave(torch.tensor([1, 4, 2]), dim=1)
    fine = simulator.rollout(theta, state, _inputs(dense), 0.02 * torch.arange(1, 8, dtype=torch.float64))
    coarse = simulator.rollout(theta, state, _inputs(commands), torch.tensor([0.02, 0.1001, 0.139]))
    assert (coarse == fine[:, [0, 4, 6]]).all()


def test_the_state_is_complete() -> None:
    simulator = _all_effects(CartPole, worlds=4)
    theta, state, commands = _random(simulator, 4, 12)
    simulator.reset(theta, state)
    for u in commands[:, :6].unbind(1):
        middle = simulator.step(_inputs(u))
    first = [simulator.step(_inputs(u)) for u in commands[:, 6:].unbind(1)][-1]
    simulator.reset(theta, middle)
    again = [simulator.step(_inputs(u)) for u in commands[:, 6:].unbind(1)][-1]
    assert (first == again).all()
    assert middle["effects", "actuator_delay@motor", "past"].any()


def test_what_a_caller_does_to_a_state_does_not_reach_the_simulator() -> None:
    simulator = _all_effects(Pendulum, worlds=1)
    theta, state, commands = _random(simulator, 1, 1)
    for given in (state, simulator.reset(theta, state), simulator.step(_inputs(commands[:, 0])), simulator.state):
        before = simulator.state
        given.apply_(lambda x: x.add_(1.0))
        assert (simulator.state == before).all()


@pytest.mark.parametrize("effect", CARTPOLE_EFFECTS, ids=lambda e: e.key)
def test_a_neutral_effect_is_nothing_bit_for_bit(effect: Effect) -> None:
    plain, grown = CartPole(FREE, 6), CartPole(FREE, 6).with_effect(effect)
    theta, state, commands = _random(plain, 6, 30)
    extended = torch.cat((theta, grown.nominal[2:].expand(6, -1)), dim=-1)
    times = plain.dt * torch.arange(1, 31, dtype=torch.float64)
    without = plain.rollout(theta, state, _inputs(commands), times)
    with_it = grown.rollout(extended, state, _inputs(commands), times)
    assert torch.equal(without["qpos"], with_it["qpos"])
    assert torch.equal(without["qvel"], with_it["qvel"])


@pytest.mark.parametrize("effect", CARTPOLE_EFFECTS, ids=lambda e: e.key)
def test_an_effect_does_something(effect: Effect) -> None:
    grown = CartPole((), 6).with_effect(effect)
    _, state, commands = _random(grown, 6, 30)
    times = grown.dt * torch.arange(1, 31, dtype=torch.float64)
    strong = grown.rollout(grown.parameters.high.expand(6, -1), state, _inputs(commands), times)
    neutral = grown.rollout(grown.nominal.expand(6, -1), state, _inputs(commands), times)
    assert (strong["qpos"] - neutral["qpos"]).abs().amax((1, 2)).min() > 1e-3


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
    ]
    for effect, values, torque in cases:
        simulator = base.with_effect(effect)
        own = {f"{effect.key}.{name}": value for name, value in values.items()}
        theta = simulator.parameters.vector({"gravity": 0.0, **own})[None]
        simulator.reset(theta, _state([[q]], [[v]]))
        after = simulator.step(_inputs(torch.zeros(1, 1)))
        torch.testing.assert_close(after["qvel"], _column(v + 3 * h * torque), rtol=1e-12, atol=0)


def test_a_stuck_joint_stays_exactly_at_rest_until_breakaway() -> None:
    # Gravity's torque at angle phi is m g l / 2 sin(phi), here 5 sin(0.2) = 0.993 N m.
    simulator = Pendulum((), 3).with_effect(DryFriction("hinge", Parameter(0, 5, "N m")))
    load = 5 * math.sin(0.2)
    theta = torch.tensor([[1.001 * load], [0.999 * load], [5.0]], dtype=torch.float64)
    simulator.reset(theta, _state([[0.2]] * 3, [[0.0]] * 3))
    for _ in range(500):
        after = simulator.step(_inputs(torch.zeros(3, 1)))
    assert after["qpos"][0].item() == 0.2
    assert after["qvel"][0].item() == 0.0
    assert after["qpos"][1].item() > 1.0
    # The third comes to rest from motion, in finite time, and then stays.
    simulator.reset(theta, _state([[0.2]] * 3, [[3.0]] * 3))
    rows = [simulator.step(_inputs(torch.zeros(3, 1)))["qpos"][2].item() for _ in range(40)]
    assert rows[-1] == rows[20] > 0.2


def test_a_delay_shifts_commands_within_dt() -> None:
    simulator = CartPole((), 1, dt=0.08).with_effect(ActuatorDelay("motor", Parameter(0, 0.2, "s")))
    plain = CartPole((), 1)
    commands = torch.randn(1, 10, 1, dtype=torch.float64).clamp(-1, 1)
    # A delay of 3 timesteps of 0.02 s is a shift of the fine staircase of commands by three.
    fine = torch.cat((torch.zeros(1, 3, 1), commands.repeat_interleave(4, dim=1)), dim=1)[:, :40]
    shifted = plain.rollout(plain.nominal[None], plain.state, _inputs(fine), 0.02 * torch.arange(1, 41))
    theta = torch.tensor([[0.06]], dtype=torch.float64)
    delayed = simulator.rollout(theta, simulator.state, _inputs(commands), 0.08 * torch.arange(1, 11))
    torch.testing.assert_close(delayed["qpos"], shifted["qpos"][:, 3::4], rtol=1e-12, atol=1e-14)


def test_a_disabled_actuator_gives_no_force() -> None:
    simulator = CartPole((), 2)
    off = TensorDict({"command": torch.ones(2, 1), "enable": torch.tensor([[0.0], [1.0]])}, batch_size=(2,))
    after = simulator.step(off)
    assert after["qvel"][0].tolist() == [0.0, 0.0]
    assert after["qvel"][1, 0] > 0.1


def test_a_diverging_world_is_held_and_flagged_and_the_others_go_on() -> None:
    simulator = CartPole(FREE, 4)
    theta, state, commands = _random(simulator, 4, 3)
    simulator.reset(theta, state)
    commands[2, 1] = torch.nan
    seen = [simulator.step(_inputs(u)) for u in commands.unbind(1)]
    assert simulator.failed.tolist() == [False, False, True, False]
    assert torch.equal(seen[2]["qpos"][2], seen[0]["qpos"][2])
    assert torch.stack([s["qpos"] for s in seen]).isfinite().all()
    assert not torch.equal(seen[2]["qpos"][3], seen[1]["qpos"][3])
    trajectory = simulator.rollout(theta, state, _inputs(commands), 0.02 * torch.arange(1, 4))
    assert trajectory["valid"].tolist() == [[True] * 3, [True] * 3, [True, False, False], [True] * 3]
    assert torch.equal(trajectory["qpos"][:, -1], seen[2]["qpos"])
    simulator.reset(theta, state, torch.tensor([True, False, True, False]))
    assert not simulator.failed.any()


def test_a_huge_state_counts_as_diverged() -> None:
    simulator = Pendulum((), 2)
    simulator.reset(simulator.theta, _state([[9.99e9], [1.1e10]], [[0.0], [0.0]]))
    simulator.step(_inputs(torch.zeros(2, 1)))
    assert simulator.failed.tolist() == [False, True]


def test_a_masked_reset_touches_its_worlds_only() -> None:
    simulator = _all_effects(CartPole, worlds=4)
    theta, state, commands = _random(simulator, 4, 5)
    simulator.reset(theta, state)
    for u in commands.unbind(1):
        before = simulator.step(_inputs(u))
    other_theta, other_state, _ = _random(simulator, 4, 1)
    mask = torch.tensor([False, True, True, False])
    after = simulator.reset(other_theta, other_state, mask)
    assert (after[~mask] == before[~mask]).all()
    assert torch.equal(after["qpos"][mask], other_state["qpos"][mask])
    assert not after["effects", "actuator_delay@motor", "past"][mask].any()  # hidden states start at rest
    assert torch.equal(simulator.theta, torch.where(mask[:, None], other_theta, theta))


def test_effects_grow_the_space_and_wrong_ones_are_refused() -> None:
    simulator = CartPole(FREE).with_effect(CARTPOLE_EFFECTS[1])
    assert simulator.parameters.names == ("length", "mass", "dry_friction@cart.frictionloss")
    assert simulator.nominal.tolist() == [0.5, 0.1, 0.0]
    assert CartPole(FREE).effects == ()
    with pytest.raises(BadInput, match="joint 'card' of dry_friction@card is unknown; nearest: cart"):
        simulator.with_effect(DryFriction("card", Parameter(0, 1)))
    with pytest.raises(BadInput, match="dry_friction@cart is already part"):
        simulator.with_effect(DryFriction("cart", Parameter(0, 1)))


def test_bad_numbers_are_refused() -> None:
    with pytest.raises(BadInput, match="whole number of timesteps"):
        CartPole((), dt=0.03)
    with pytest.raises(BadInput, match="at least one world"):
        CartPole((), worlds=0)


def test_a_torque_on_the_pole_obeys_the_mass_matrix() -> None:
    # Lagrange: M = [[M + m, m l cos], [m l cos, 4/3 m l^2]]; M times the change of acceleration is the added force.
    simulator = CartPole(FREE, 50)
    theta, state, _ = _random(simulator, 50, 1)
    values = {**simulator.parameters.view(theta), "masscart": torch.ones(50), "gravity": torch.full((50,), 9.8)}
    q, v, tau = state["qpos"].T, state["qvel"].T, torch.randn(2, 50, dtype=torch.float64)
    change = simulator.acceleration(values, q, v, tau) - simulator.acceleration(values, q, v, torch.zeros_like(tau))
    length, mass = theta.unbind(-1)
    cross = mass * length * q[1].cos()
    forces = ((1 + mass) * change[0] + cross * change[1], cross * change[0] + 4 / 3 * mass * length**2 * change[1])
    torch.testing.assert_close(torch.stack(forces), tau, rtol=1e-9, atol=1e-9)


def test_float32_is_carried_through() -> None:
    simulator = CartPole(FREE, 2, dtype=torch.float32).with_effect(CARTPOLE_EFFECTS[6])
    state = simulator.step(_inputs(torch.ones(2, 1)))
    assert {x.dtype for x in state.values(True, True)} == {torch.float32}
    assert simulator.theta.dtype == simulator.nominal.dtype == torch.float32


@pytest.mark.gpu
def test_on_a_gpu_it_gives_what_the_cpu_gives() -> None:
    results = []
    for device in ("cpu", "cuda"):
        simulator = CartPole(FREE, 64, device=device)
        for effect in CARTPOLE_EFFECTS:
            simulator = simulator.with_effect(effect)
        torch.manual_seed(0)
        theta, state, commands = _random(simulator, 64, 30)
        times = simulator.dt * torch.arange(1, 31, dtype=torch.float64)
        out = simulator.rollout(theta.to(device), state.to(device), _inputs(commands).to(device), times)
        assert out.device.type == device
        results.append(out["qpos"].cpu())
    torch.testing.assert_close(*results, rtol=1e-8, atol=1e-8)


def _all_effects(system: type[TorchSimulator], worlds: int, steps_per_dt: int = 1) -> TorchSimulator:
    simulator = system(FREE, worlds, dt=steps_per_dt * system.timestep)
    joint = system.joints[0].name
    return (
        simulator.with_effect(DryFriction(joint, Parameter(0, 0.5)))
        .with_effect(ViscousFriction(joint, Parameter(0, 0.5)))
        .with_effect(ActuatorDelay("motor", Parameter(0, 0.1, "s")))
    )


def _random(simulator: TorchSimulator, worlds: int, steps: int) -> tuple[Tensor, TensorDict, Tensor]:
    space, joints = simulator.parameters, len(simulator.joints)
    low = torch.where(
        space.low > 0, space.low.clamp(min=0.1), space.low
    )  # physical bounds are wide: keep to the middle
    theta = low + torch.rand(worlds, len(space), dtype=torch.float64) * (space.high.clamp(max=1.0) - low)
    q, v = 0.3 * torch.randn(2, worlds, joints, dtype=torch.float64)
    return theta, _state(q, v), torch.rand(worlds, steps, 1, dtype=torch.float64) * 2 - 1


def _state(q: list | Tensor, v: list | Tensor) -> TensorDict:
    q, v = (torch.as_tensor(x, dtype=torch.float64) for x in (q, v))
    return TensorDict({"qpos": q, "qvel": v}, batch_size=(len(q),))


def _inputs(command: Tensor) -> TensorDict:
    return TensorDict({"command": command}, batch_size=command.shape[:-1])


def _column(value: float) -> Tensor:
    return torch.tensor([[value]], dtype=torch.float64)
