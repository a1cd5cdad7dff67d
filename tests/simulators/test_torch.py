"""Torch systems: one world like many, steps like a rollout, failures that stay alone."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from envs.cartpole import CartPole
from envs.pendulum import Pendulum
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Actuator, Joint, TorchSimulator
from onlinebayes.simulators.testing import check_simulator
from tests.simulators.systems import CARTPOLE_EFFECTS, FREE, all_effects, draw, inputs, state_of

PRIOR = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})


@pytest.mark.parametrize("system", [CartPole, Pendulum])
def test_contract(system: type[TorchSimulator]) -> None:
    check_simulator(system(PRIOR))
    check_simulator(system(PRIOR, dt=3 * system.timestep, dtype=torch.float32), scale=0.5)


def test_the_documented_system_runs_as_it_stands(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "concepts" / "simulators.md").read_text(encoding="utf-8")
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "class Slider" in block)
    (tmp_path / "slider.py").write_text(code, encoding="utf-8")
    simulator = runpy.run_path(str(tmp_path / "slider.py"))["Slider"](["mass"])
    simulator.reset(torch.tensor([[4.0]], dtype=torch.float64))
    assert float(simulator.step(inputs(torch.tensor([[3.0]])))["qvel"]) == pytest.approx(0.01 * 2.0 * 3.0 / 4.0)


class Slider(TorchSimulator):
    """A mass on a rail pushed by two motors, of which one has a gear that is a parameter and one a limit."""

    physical = ParameterSpace({"mass": Parameter(0.1, 10.0, "kg"), "kt": Parameter(0.0, 5.0, "N")})
    defaults = {"mass": 1.0, "kt": 2.0}  # noqa: RUF012
    joints = (Joint("carriage", "slide"),)
    actuators = (Actuator("motor", "carriage", gear="kt"), Actuator("brake", "carriage", gear=-0.5, limit=1.0))
    timestep = 0.01

    def acceleration(self, parameters, q, v, tau):
        return tau / parameters["mass"]


def test_a_system_of_ones_own() -> None:
    simulator = Slider(["mass", "kt"], worlds=2)
    check_simulator(simulator)
    theta = torch.tensor([[2.0, 3.0], [4.0, 0.0]], dtype=torch.float64)
    simulator.reset(theta)
    after = simulator.step(inputs(torch.tensor([[1.0, 7.0], [1.0, 7.0]])))
    force = torch.tensor([[3.0 - 0.5], [-0.5]], dtype=torch.float64)  # the brake's command is cut off at 1
    torch.testing.assert_close(after["qvel"], 0.01 * force / theta[:, :1])
    assert simulator.joint_kinds == {"carriage": "slide"}


def test_a_rollout_takes_rows_at_uneven_times_and_held_commands() -> None:
    simulator = CartPole(FREE)
    theta, state, commands = draw(simulator, 5, 3)
    dense = commands.repeat_interleave(torch.tensor([1, 4, 2]), dim=1)
    fine = simulator.rollout(theta, state, inputs(dense), 0.02 * torch.arange(1, 8, dtype=torch.float64))
    coarse = simulator.rollout(theta, state, inputs(commands), torch.tensor([0.02, 0.1001, 0.139]))
    assert (coarse == fine[:, [0, 4, 6]]).all()


def test_what_a_caller_does_to_a_state_does_not_reach_the_simulator() -> None:
    simulator = all_effects(Pendulum, worlds=1)
    theta, state, commands = draw(simulator, 1, 1)
    for given in (state, simulator.reset(theta, state), simulator.step(inputs(commands[:, 0])), simulator.state):
        before = simulator.state
        given.apply_(lambda x: x.add_(1.0))
        assert (simulator.state == before).all()


def test_a_disabled_actuator_gives_no_force() -> None:
    simulator = CartPole((), 2)
    off = TensorDict({"command": torch.ones(2, 1), "enable": torch.tensor([[0.0], [1.0]])}, batch_size=(2,))
    after = simulator.step(off)
    assert after["qvel"][0].tolist() == [0.0, 0.0]
    assert after["qvel"][1, 0] > 0.1


def test_a_diverging_world_is_held_and_flagged_and_the_others_go_on() -> None:
    simulator = CartPole(FREE, 4)
    theta, state, commands = draw(simulator, 4, 3)
    simulator.reset(theta, state)
    commands[2, 1] = torch.nan
    seen = [simulator.step(inputs(u)) for u in commands.unbind(1)]
    assert simulator.failed.tolist() == [False, False, True, False]
    assert torch.equal(seen[2]["qpos"][2], seen[0]["qpos"][2])
    assert torch.stack([s["qpos"] for s in seen]).isfinite().all()
    assert not torch.equal(seen[2]["qpos"][3], seen[1]["qpos"][3])
    trajectory = simulator.rollout(theta, state, inputs(commands), 0.02 * torch.arange(1, 4))
    assert trajectory["valid"].tolist() == [[True] * 3, [True] * 3, [True, False, False], [True] * 3]
    assert torch.equal(trajectory["qpos"][:, -1], seen[2]["qpos"])
    simulator.reset(theta, state, torch.tensor([True, False, True, False]))
    assert not simulator.failed.any()


def test_a_huge_state_counts_as_diverged() -> None:
    simulator = Pendulum((), 2)
    simulator.reset(simulator.theta, state_of([[9.99e9], [1.1e10]], [[0.0], [0.0]]))
    simulator.step(inputs(torch.zeros(2, 1)))
    assert simulator.failed.tolist() == [False, True]


def test_a_masked_reset_touches_its_worlds_only() -> None:
    simulator = all_effects(CartPole, worlds=4)
    theta, state, commands = draw(simulator, 4, 5)
    simulator.reset(theta, state)
    for u in commands.unbind(1):
        before = simulator.step(inputs(u))
    other_theta, other_state, _ = draw(simulator, 4, 1)
    mask = torch.tensor([False, True, True, False])
    after = simulator.reset(other_theta, other_state, mask)
    assert (after[~mask] == before[~mask]).all()
    assert torch.equal(after["qpos"][mask], other_state["qpos"][mask])
    assert not after["effects", "actuator_delay@motor", "past"][mask].any()  # hidden states start at rest
    assert torch.equal(simulator.theta, torch.where(mask[:, None], other_theta, theta))


def test_a_finer_timestep_converges_to_the_same_motion() -> None:
    # Euler's error is of first order in the step: a tenth of the step leaves a tenth of the error.
    coarse = Pendulum(())
    state = state_of([[0.5]], [[0.0]])
    ends = []
    for refine in (10, 100, 1000):
        simulator = coarse.with_timestep(coarse.timestep / refine)
        command = torch.full((1, 1, 1), 0.3, dtype=torch.float64)
        ends.append(float(simulator.rollout(simulator.theta, state, inputs(command), torch.tensor([0.5]))["qpos"]))
    assert abs(ends[1] - ends[2]) == pytest.approx(abs(ends[0] - ends[1]) / 10, rel=0.1)


def test_bad_numbers_are_refused() -> None:
    with pytest.raises(BadInput, match="whole number of timesteps"):
        CartPole((), dt=0.03)
    with pytest.raises(BadInput, match="at least one world"):
        CartPole((), worlds=0)
    with pytest.raises(BadInput, match="timestep = 0 s; it must be positive"):
        CartPole(()).with_timestep(0.0)
    with pytest.raises(BadInput, match="whole number"):
        CartPole(()).with_dt(0.7 * CartPole(()).timestep)


def test_a_step_lasts_as_long_as_it_is_asked_to() -> None:
    one = CartPole(()).with_worlds(1)
    three = one.with_dt(3 * one.timestep)
    inputs = TensorDict({"command": torch.ones(1, 1, dtype=one.dtype)}, batch_size=[1])
    for _ in range(3):
        after = one.step(inputs)
    assert torch.equal(three.step(inputs)["qpos"], after["qpos"])
    assert three.timestep == one.timestep
    with pytest.raises(ValueError, match="theta has 3 columns, the space has 2 parameters"):
        CartPole(FREE).reset(torch.ones(1, 3, dtype=torch.float64))


def test_a_torque_on_the_pole_obeys_the_mass_matrix() -> None:
    # Lagrange: M = [[M + m, m l cos], [m l cos, 4/3 m l^2]]; M times the change of acceleration is the added force.
    simulator = CartPole(FREE, 50)
    theta, state, _ = draw(simulator, 50, 1)
    values = {**simulator.parameters.view(theta), "masscart": torch.ones(50), "gravity": torch.full((50,), 9.8)}
    q, v, tau = state["qpos"].T, state["qvel"].T, torch.randn(2, 50, dtype=torch.float64)
    change = simulator.acceleration(values, q, v, tau) - simulator.acceleration(values, q, v, torch.zeros_like(tau))
    length, mass = theta.unbind(-1)
    cross = mass * length * q[1].cos()
    forces = ((1 + mass) * change[0] + cross * change[1], cross * change[0] + 4 / 3 * mass * length**2 * change[1])
    torch.testing.assert_close(torch.stack(forces), tau, rtol=1e-9, atol=1e-9)


def test_float32_is_carried_through() -> None:
    simulator = CartPole(FREE, 2, dtype=torch.float32).with_effect(CARTPOLE_EFFECTS[6])
    state = simulator.step(inputs(torch.ones(2, 1)))
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
        theta, state, commands = draw(simulator, 64, 30)
        times = simulator.dt * torch.arange(1, 31, dtype=torch.float64)
        out = simulator.rollout(theta.to(device), state.to(device), inputs(commands).to(device), times)
        assert out.device.type == device
        results.append(out["qpos"].cpu())
    torch.testing.assert_close(*results, rtol=1e-8, atol=1e-8)
