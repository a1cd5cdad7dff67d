"""CartPole equals Gymnasium's, whatever its parameters; its task too."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.runs import BadInput
from tests.envs import gym

NAMES = ("length", "mass", "masscart", "gravity", "force")
CASES = [
    {},
    {"length": 0.1, "mass": 1.0},
    {"length": 1.0, "mass": 0.1},
    {"length": 0.37, "mass": 0.83, "masscart": 2.5, "gravity": 3.7, "force": 4.0},
]


@pytest.mark.parametrize("changed", CASES)
def test_equals_gymnasium_over_200_steps(changed: dict[str, float]) -> None:
    generator = np.random.default_rng(1)
    start, actions = generator.uniform(-0.05, 0.05, 4), generator.integers(2, size=200)
    states, rewards, terminated = gym.trajectory(gym.cartpole(**changed), start, actions)

    simulator, task = CartPole(NAMES), CartPoleTask()
    theta = simulator.parameters.vector({**CartPole.defaults, **changed})[None]
    state = simulator.reset(theta, _state(start))
    for k, action in enumerate(actions):
        one_hot = torch.nn.functional.one_hot(torch.tensor([action]), 2)
        after = simulator.step(TensorDict({"command": task.command(one_hot)}, batch_size=(1,)))
        np.testing.assert_allclose(task.observe(after)[0], states[k].astype(np.float32), rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(_flat(after), states[k], rtol=1e-6, atol=1e-6)
        assert float(task.reward(state, one_hot, after)) == rewards[k]
        assert bool(task.terminated(after)) == terminated[k]
        state = after
    assert terminated.any()
    assert not simulator.failed.any()


def test_start_is_gymnasiums_box() -> None:
    generator = torch.Generator().manual_seed(0)
    start = CartPoleTask().start(torch.zeros(1000, 2, dtype=torch.float64), generator)
    everything = torch.cat((start["qpos"], start["qvel"]))
    assert everything.abs().max() <= 0.05
    assert everything.max() > 0.0495
    assert everything.min() < -0.0495


def test_parameters_are_chosen_by_name_and_unknown_ones_refused() -> None:
    simulator = CartPole(["mass", "length"], worlds=3)
    assert simulator.parameters.names == ("mass", "length")
    assert simulator.nominal.tolist() == [0.1, 0.5]
    with pytest.raises(BadInput, match="parameter 'lenght' is unknown; nearest: length"):
        CartPole(["lenght"])


def _state(x: np.ndarray) -> TensorDict:
    x = torch.as_tensor(x)
    return TensorDict({"qpos": x[None, [0, 2]], "qvel": x[None, [1, 3]]}, batch_size=(1,))


def _flat(state: TensorDict) -> np.ndarray:
    return torch.stack((state["qpos"], state["qvel"]), dim=-1).flatten().numpy()
