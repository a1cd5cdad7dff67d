"""The objective of a planner: told the belief, never taught."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictModuleBase
from torch import nn

from onlinebayes.objectives import Objective, Planned, TakesBelief
from onlinebayes.runs import BadInput


class Follower(TensorDictModuleBase):
    """Acts as the belief's first draw says."""

    def __init__(self) -> None:
        self.in_keys, self.out_keys = ["observation"], ["action"]
        super().__init__()
        self.register_buffer("theta", torch.zeros(1))

    def set_belief(self, belief) -> None:
        self.theta.copy_(belief.sample((1,))[0])

    def forward(self, tensordict):
        return tensordict.set("action", self.theta.expand(*tensordict.batch_size, 1))


class Seven:
    def sample(self, shape):
        return torch.full((*shape, 1), 7.0)


def test_it_is_an_objective_that_hands_the_belief_on_and_keeps_its_state() -> None:
    objective, other = Planned(Follower()), Planned(Follower())
    assert isinstance(objective, Objective)
    assert isinstance(objective, TakesBelief)
    objective.set_belief(Seven())
    other.load_state_dict(objective.state_dict())
    assert other.policy(TensorDict(batch_size=[2]))["action"].tolist() == [[7.0], [7.0]]


def test_refusals() -> None:
    with pytest.raises(BadInput, match="policy_batches=0"):
        Planned(Follower()).update(TensorDict(batch_size=[1, 1]))
    with pytest.raises(BadInput, match="TensorDictModule has no set_belief"):
        Planned(TensorDictModule(nn.Linear(1, 1), in_keys=["observation"], out_keys=["action"]))
