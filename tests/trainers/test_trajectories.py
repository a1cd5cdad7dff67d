from __future__ import annotations

import pytest
import torch
from tensordict.nn import TensorDictModule
from torchrl.envs import TransformedEnv

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers import RealEnvironment, returns, trajectories
from onlinebayes.transforms import ParameterRandomization

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})


push_right = TensorDictModule(
    lambda o: torch.tensor([0, 1]).expand(*o.shape[:-1], 2).clone(), in_keys=["observation"], out_keys=["action"]
)


def env(worlds: int, horizon: int = 500) -> TransformedEnv:
    base = SimulatorEnv(CartPole(SPACE, worlds), CartPoleTask(horizon))
    return TransformedEnv(base, ParameterRandomization(BoxUniform(SPACE)))


def test_the_mask_ends_with_the_first_episode():
    data = trajectories(env(32), push_right, 50)
    assert data.shape == (32, 50)
    length = data["mask"].sum(1)
    assert ((length > 3) & (length < 50)).all(), "a cart pushed to one side drops its pole within 50 steps"
    # Up to the end the cart only gains speed; the first observation after it is a fresh start.
    for row, n in zip(data, length.tolist(), strict=True):
        assert (row["observation"][1:n, 1] > row["observation"][: n - 1, 1]).all()
        assert torch.equal(row["next", "observation"][: n - 1], row["observation"][1:n])
        assert not torch.equal(row["next", "observation"][n - 1], row["observation"][n])


def test_theta_is_that_of_the_first_episode():
    data = trajectories(env(32), push_right, 50)
    assert (data["theta"] == data["theta"][:, :1]).all()
    assert SPACE.contains(data["theta"]).all()
    assert len(torch.unique(data["theta"][:, 0], dim=0)) == 32


def test_a_return_counts_the_first_episode_only():
    length = trajectories(env(16), push_right, 60)["mask"].sum(1).double()
    total = returns(env(16), push_right, 60).double()
    assert (total < 20).all()
    assert abs(total.mean() - length.mean()) < 4


def test_a_hidden_system_gives_a_trajectory_and_nothing_else():
    system = RealEnvironment(env(1))
    data = system.run(push_right, 50)
    assert data.shape == (1, 50)
    assert "theta" not in data.keys(True)
    assert {"observation", "action", "mask"} <= set(data.keys())
    assert [name for name in dir(system) if not name.startswith("_")] == ["load_state_dict", "run", "state_dict"]
    with pytest.raises(AttributeError):
        system.theta = torch.zeros(2)  # type: ignore[attr-defined]
