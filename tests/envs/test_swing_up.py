"""The swing-up of a cart-pole, by torch's equations and by MuJoCo."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict
from torchrl.envs.utils import check_env_specs

from envs.cartpole import CartPole
from envs.swing_up import PHYSICAL, SwingUpTask, cart_pole, state_of
from onlinebayes.simulators import Simulator, SimulatorEnv
from onlinebayes.simulators.testing import check_simulator


def test_conformance() -> None:
    simulator = cart_pole()
    check_simulator(simulator)
    assert bool(PHYSICAL.contains(simulator.nominal))


@pytest.mark.parametrize("simulator", [CartPole(worlds=3, dt=0.04), cart_pole(worlds=3)])
def test_any_cart_pole_can_be_swung_up(simulator: Simulator) -> None:
    env = SimulatorEnv(simulator, SwingUpTask(horizon=5))
    check_env_specs(env)
    begun = env.reset()["observation"]
    assert bool((begun[:, 2] < -0.99).all())
    assert env.rollout(5)["next", "truncated"][:, -1].all()


def test_both_have_the_same_sense() -> None:
    """A pole that leans to one side falls there, and a push to the right moves the cart there."""
    for simulator in (CartPole(worlds=2, dt=0.04), cart_pole(worlds=2)):
        state = TensorDict({"qpos": torch.tensor([[0.0, 0.2], [0.0, math.pi]]).double()}, batch_size=(2,))
        simulator.reset(simulator.theta, state.set("qvel", torch.zeros(2, 2).double()))
        for _ in range(3):
            after = simulator.step(TensorDict({"command": torch.tensor([[0.0], [1.0]]).double()}, batch_size=(2,)))
        assert float(after["qpos"][0, 1]) > 0.2
        assert float(after["qpos"][1, 0]) > 0.01


def test_upright_at_rest_in_the_middle_is_best() -> None:
    task = SwingUpTask()
    states = TensorDict(
        {"qpos": torch.tensor([[0.0, 0.0], [0.0, math.pi], [1.0, 2 * math.pi]]), "qvel": torch.zeros(3, 2)},
        batch_size=(3,),
    )
    reward = task.reward(states, torch.zeros(3, 1), states)
    assert torch.allclose(reward, torch.tensor([0.0, -2.0, -0.1]), atol=1e-6)
    assert torch.allclose(state_of(task.observe(states))["qpos"][:2].abs(), states["qpos"][:2].double(), atol=1e-6)
