"""DDPG with goals told in hindsight, piece by piece, in a plain TorchRL loop."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torchrl.collectors import Collector
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase, StepCounter, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.objectives import DDPGSettings, Hindsight, ddpg

KEYS = ("observation", "desired_goal")


def reward(achieved: torch.Tensor, desired: torch.Tensor) -> torch.Tensor:
    return ((achieved - desired).norm(dim=-1) < 0.1).float() - 1


class Points(EnvBase):
    """Points of the plane that move by .1 of the action, from the origin to a goal; -1 each step until it is near."""

    def __init__(self, n: int = 16) -> None:
        super().__init__(batch_size=(n,))
        place = Unbounded((n, 2))
        names = ("observation", "achieved_goal", "desired_goal")
        self.observation_spec = Composite({name: place.clone() for name in names}, shape=(n,))
        self.action_spec, self.reward_spec = Bounded(-1, 1, (n, 2)), Unbounded((n, 1))

    def _reset(self, tensordict: TensorDictBase | None = None) -> TensorDict:
        angle = 2 * torch.pi * torch.rand(*self.batch_size, 1)
        goal = torch.cat([angle.cos(), angle.sin()], -1) * (0.5 + 0.5 * torch.rand_like(angle))
        return self._told(torch.zeros_like(goal), goal)

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        after = self._told(tensordict["observation"] + 0.1 * tensordict["action"], tensordict["desired_goal"])
        after["reward"] = reward(after["achieved_goal"], after["desired_goal"]).unsqueeze(-1)
        return after.set("done", torch.zeros(*self.batch_size, 1, dtype=torch.bool))

    def _told(self, place: torch.Tensor, goal: torch.Tensor) -> TensorDict:
        return TensorDict({"observation": place, "achieved_goal": place, "desired_goal": goal}, self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        torch.manual_seed(0 if seed is None else seed)


@pytest.mark.usefixtures("without_shape_checks")
def test_hindsight_in_a_loop_of_ones_own():
    env = TransformedEnv(Points(), StepCounter(max_steps=20))
    objective = ddpg(
        env.observation_spec_unbatched,
        env.action_spec_unbatched,
        DDPGSettings(widths=(64, 64), minibatch=64, gamma=0.95, value_range=(-20.0, 0.0), action_penalty=0.1),
        in_keys=KEYS,
        hindsight=Hindsight(reward),
    )
    policy, loss, buffer, optimiser = objective.policy, objective.loss, objective.buffer, objective.optimiser
    collector = Collector(env, policy, frames_per_batch=320, total_frames=6400, auto_register_policy_transforms=False)
    for data in collector:
        objective.inputs.observe(data)
        buffer.extend(data)
        for _ in range(40):
            losses = loss(buffer.sample())
            (losses["loss_actor"] + losses["loss_value"]).backward()
            optimiser.step()
            optimiser.zero_grad()
            objective.target.step()
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        last = env.rollout(20, policy)[:, -1]
    collector.shutdown()
    assert (last["next", "reward"] == 0).float().mean() > 0.9
