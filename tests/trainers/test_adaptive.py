"""A planner that learns while it acts: when it infers, from what, and that it goes on where it stood."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictModuleBase

from onlinebayes.runs import BadInput
from onlinebayes.trainers import AdaptivePlanner, Point


class Proportional(TensorDictModuleBase):
    """Gives theta times what it sees."""

    def __init__(self) -> None:
        self.in_keys, self.out_keys = ["observation"], ["action"]
        super().__init__()
        self.register_buffer("gain", torch.zeros(1))

    def set_belief(self, belief) -> None:
        self.gain.copy_(belief.sample((1,))[0])

    def forward(self, tensordict):
        return tensordict.set("action", self.gain * tensordict["observation"])


def steps(policy, values, began=()) -> list[float]:
    given = []
    for k, value in enumerate(values):
        seen = TensorDict({"observation": torch.tensor([[value]]), "is_init": torch.tensor([[k in began]])}, [1])
        given.append(float(policy(seen)["action"]))
    return given


def test_the_belief_of_the_last_steps_is_what_the_next_command_is_planned_for() -> None:
    asked = []

    def infer(trajectory):
        asked.append(
            (trajectory["observation"].flatten().tolist(), trajectory["next", "observation"].flatten().tolist())
        )
        return Point(torch.tensor([float(len(asked))]))

    policy = AdaptivePlanner(Proportional(), infer, every=2, memory=3)
    assert steps(policy, [1.0, 2.0, 3.0, 4.0, 5.0], began=(0,)) == [0, 0, 3, 4, 10]
    assert asked == [([1, 2], [2, 3]), ([2, 3, 4], [3, 4, 5])]
    assert steps(policy, [6.0, 7.0], began=(0,)) == [12, 14], "a new episode begins with the belief of the last"
    assert policy.trajectory()["action"].flatten().tolist() == [12]


def test_it_goes_on_where_it_stood() -> None:
    def infer(trajectory):
        return Point(trajectory["observation"].sum().reshape(1))

    first, second = (AdaptivePlanner(Proportional(), infer, every=2) for _ in range(2))
    steps(first, [1.0, 2.0, 3.0])
    second.load_state_dict(first.state_dict())
    assert steps(second, [4.0, 5.0]) == steps(first, [4.0, 5.0])


def test_refusals() -> None:
    with pytest.raises(BadInput, match="has no set_belief"):
        AdaptivePlanner(TensorDictModule(torch.nn.Identity(), ["observation"], ["action"]), Point)
    with pytest.raises(BadInput, match="1 <= every <= memory"):
        AdaptivePlanner(Proportional(), Point, every=4, memory=2)
    with pytest.raises(BadInput, match="2 systems at once"):
        AdaptivePlanner(Proportional(), Point)(TensorDict({"observation": torch.zeros(2, 1)}, [2]))
