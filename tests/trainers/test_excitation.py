"""A machine that its policy hardly moves is moved on purpose, within the limits that its owner gives."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.data import Bounded, OneHot

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers import Excited, HeldActions, Limits, RealEnvironment, RealSystem, range_of

INF = torch.inf
LIMITS = Limits(torch.tensor([-0.1, -INF]), torch.tensor([0.1, INF]), lambda seen: -torch.sign(seen[..., :1]))
STILL = TensorDictModule(lambda seen: torch.zeros_like(seen[..., :1]), ["observation"], ["action"])


class Slider:
    """Two carts that move by a tenth of their action; keeps what it was asked."""

    def __init__(self) -> None:
        self.asked: list[int] = []

    def run(self, policy: TensorDictModule, steps: int) -> TensorDict:
        self.asked.append(steps)
        at, rows = torch.zeros(2, 2), []
        for _ in range(steps):
            row = policy(TensorDict({"observation": at}, (2,)))
            at = at + 0.1 * torch.cat([row["action"], row["action"]], 1)
            rows.append(row.set("next", TensorDict({"observation": at}, (2,))))
        return torch.stack(rows, 1)


def excited(least: float = 0.05, most: int = 1) -> tuple[Excited, Slider]:
    slider = Slider()
    policy = HeldActions(Bounded(-0.5, 0.5, (1,)), 4, LIMITS)
    return Excited(slider, policy, range_of(0), least=least, steps=20, most=most), slider


def test_where_the_policy_hardly_moves_it_an_excitation_follows_and_no_second_one() -> None:
    real, slider = excited()
    assert isinstance(real, RealSystem)
    data = real.run(STILL, 8)
    assert slider.asked == [8, 20]
    assert data.shape == (4, 20)
    assert data["mask"].sum(1).tolist() == [8, 8, 20, 20]
    moved = range_of(0)(data)
    assert (moved[:2] == 0).all()
    assert (moved[2:] > 0).all()
    real.run(STILL, 8)
    assert slider.asked == [8, 20, 8]


def test_a_policy_that_moves_it_is_left_alone() -> None:
    real, slider = excited()
    policy = TensorDictModule(lambda seen: torch.ones_like(seen[..., :1]), ["observation"], ["action"])
    assert len(real.run(policy, 8)) == 2
    assert slider.asked == [8]


def test_actions_are_allowed_held_and_lead_back_outside_the_limits() -> None:
    torch.manual_seed(0)
    real, _ = excited()
    data = real.run(STILL, 8)[2:]
    seen, action = data["observation"][..., 0], data["action"][..., 0]
    outside = seen.abs() > 0.1
    assert outside.any()
    assert torch.equal(action[outside], -torch.sign(seen[outside]))
    assert action[~outside].abs().max() <= 0.5
    for world in range(2):
        for block in range(5):
            inside = action[world, 4 * block : 4 * block + 4][~outside[world, 4 * block : 4 * block + 4]]
            assert len(inside.unique()) <= 1
    # A step outside is no longer than the one that led there: .05 beyond the limit, and .1 the way back.
    assert seen.abs().max() <= 0.1 + 0.05 + 1e-6


def test_it_goes_on_where_it_stood() -> None:
    first, _ = excited(most=2)
    first.run(STILL, 8)
    second, slider = excited(most=2)
    second.load_state_dict(first.state_dict())
    for _ in range(3):
        second.run(STILL, 8)
    assert slider.asked == [8, 20, 8, 8]


def test_choices_and_padded_trajectories() -> None:
    env = SimulatorEnv(CartPole(["mass"], 3), CartPoleTask())
    limits = Limits(
        -torch.ones(4), torch.ones(4), lambda seen: torch.eye(2, dtype=torch.int64)[(seen[..., 0] < 0).long()]
    )
    real = Excited(
        RealEnvironment(env), HeldActions(OneHot(2, dtype=torch.int64), 3, limits), range_of(0), least=9.0, steps=100
    )
    left = TensorDictModule(
        lambda seen: torch.eye(2, dtype=torch.int64)[torch.zeros(3).long()], ["observation"], ["action"]
    )
    data = real.run(left, 5)
    assert data.shape == (6, 100)
    assert (data["action"].sum(-1)[data["mask"]] == 1).all()
    assert (data["mask"].sum(1) < 100).all(), "the pole ends each of them"


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Limits(torch.ones(2), torch.zeros(2), lambda seen: seen), "give a low and a higher high"),
        (lambda: HeldActions(OneHot(2), 0, LIMITS), "one or more"),
        (lambda: Excited(Slider(), STILL, range_of(0), least=0.0, steps=1), "positive"),
    ],
)
def test_what_cannot_be_is_refused(make, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        make()
