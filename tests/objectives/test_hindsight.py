from __future__ import annotations

import copy

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.objectives.hindsight import EpisodeReplay, Hindsight, leads_elsewhere, steps_left
from onlinebayes.runs import BadInput

GAMMA = 0.9


def near(achieved: Tensor, desired: Tensor) -> Tensor:
    return (achieved - desired).abs().sum(-1) < 0.5


def reward(achieved: Tensor, desired: Tensor) -> Tensor:
    return near(achieved, desired).float() - 1


HINDSIGHT = Hindsight(reward)


def episodes(n: int, t: int, *, first: int = 0, length: int | None = None) -> TensorDict:
    """Rows that tell where they are: the observation is (episode, step), the goal reached after step u is u + 1.

    Every ``length`` steps an episode is done; without it a row is cut in the middle of one. The recorded reward is -7.
    """
    step = torch.arange(t).repeat(n, 1)
    within = step if length is None else step % length
    row = torch.arange(first, first + n).unsqueeze(1)
    episode = row.expand(n, t) if length is None else row * 1000 + step // length
    done = torch.zeros(n, t, 1, dtype=torch.bool) if length is None else ((within + 1) == length).unsqueeze(-1)
    place = torch.stack([episode, within], -1).float()
    return TensorDict(
        {
            "observation": place,
            "action": torch.rand(n, t, 1),
            "achieved_goal": within.unsqueeze(-1).float(),
            "desired_goal": torch.full((n, t, 1), 1e6),
            "next": {
                "observation": place + torch.tensor([0.0, 1.0]),
                "achieved_goal": within.unsqueeze(-1).float() + 1,
                "desired_goal": torch.full((n, t, 1), 1e6),
                "reward": torch.full((n, t, 1), -7.0),
                "done": done,
                "terminated": torch.zeros_like(done),
                "truncated": done.clone(),
            },
        },
        (n, t),
    )


def test_a_goal_is_one_that_the_same_episode_reached_later():
    buffer = EpisodeReplay(1000, 4000, hindsight=HINDSIGHT, gamma=GAMMA)
    buffer.extend(episodes(10, 60, length=15))
    batch = buffer.sample()
    anew = batch["desired_goal"][:, 0] < 1e5
    # A share of 4 / 5: 4000 draws lie outside four standard deviations with probability 6e-5, and the seed is fixed.
    assert anew.float().mean().sub(0.8).abs() < 4 * (0.16 / 4000) ** 0.5
    goal, step = batch["desired_goal"][anew, 0], batch["observation"][anew, 1]
    assert (goal > step).all(), "the state before the step is no goal: the step has not reached it"
    assert (goal <= 15).all()
    assert set(goal[step == 0].tolist()) == set(range(1, 16)), "every later state is a goal"
    assert (goal[step == 14] == 15).all()
    assert torch.equal(batch["desired_goal"], batch["next", "desired_goal"])
    told = batch["next", "reward"][:, 0]
    assert torch.equal(told[anew], torch.where(goal == step + 1, 0.0, -1.0))
    assert (told[~anew] == -7).all()


def test_a_row_that_is_cut_ends_an_episode():
    buffer = EpisodeReplay(1000, 2000, hindsight=HINDSIGHT, steps=4, gamma=GAMMA)
    buffer.extend(episodes(6, 7))
    buffer.extend(episodes(6, 7, first=6))
    batch = buffer.sample()
    assert torch.equal(batch["observation"][:, 0], batch["next", "observation"][:, 0])
    assert (batch["next", "observation"][:, 1] <= 7).all()
    assert (batch["desired_goal"][batch["desired_goal"] < 1e5] <= 7).all()


@pytest.mark.parametrize("size", [64, 100, 97])
def test_a_ring_that_is_full_goes_on(size):
    buffer = EpisodeReplay(size, 512, hindsight=HINDSIGHT, steps=3, gamma=GAMMA)
    for k in range(12):
        buffer.extend(episodes(2, 21, first=2 * k, length=7))
        batch = buffer.sample()
        assert torch.equal(batch["observation"][:, 0], batch["next", "observation"][:, 0]), "of one episode"
        moved = batch["next", "observation"][:, 1] - batch["observation"][:, 1]
        assert torch.equal(moved, batch["steps_to_next_obs"][:, 0].float())
        anew = batch["desired_goal"][:, 0] < 1e5
        goal, step = batch["desired_goal"][anew, 0], batch["observation"][anew, 1]
        assert ((goal > step) & (goal <= 7)).all()
    assert len(buffer) == size
    oldest = 24 * 21 - size
    assert batch["observation"][:, 0].min() >= 1000 * (oldest // 21), "the oldest steps are overwritten"


def test_a_batch_larger_than_the_ring_leaves_its_last_steps():
    buffer = EpisodeReplay(10, 200, hindsight=HINDSIGHT, gamma=GAMMA)
    buffer.extend(episodes(3, 8))
    batch = buffer.sample()
    assert set(batch["observation"][:, 0].tolist()) == {1.0, 2.0}


def test_returns_of_several_steps_are_cut_at_the_end():
    buffer = EpisodeReplay(100, 400, steps=3, gamma=GAMMA)
    data = episodes(2, 10, length=5)
    data["next", "reward"] = data["observation"][..., 1:].clone()
    buffer.extend(data)
    batch = buffer.sample()
    for step, told, m, following, done in zip(
        batch["observation"][:, 1],
        batch["next", "reward"][:, 0],
        batch["steps_to_next_obs"][:, 0],
        batch["next", "observation"][:, 1],
        batch["next", "done"][:, 0],
        strict=True,
    ):
        count = min(3, 5 - int(step))
        assert m == count
        assert following == step + count
        assert done == (step + count == 5)
        assert told == pytest.approx(sum(GAMMA**i * (float(step) + i) for i in range(count)))


def test_one_that_terminates_at_its_goal_ends_there():
    buffer = EpisodeReplay(100, 1000, steps=3, gamma=GAMMA, hindsight=Hindsight(reward, near, k=1e9))
    buffer.extend(episodes(2, 8))
    batch = buffer.sample()
    away = batch["desired_goal"][:, 0] - batch["observation"][:, 1]
    m = batch["steps_to_next_obs"][:, 0]
    assert torch.equal(batch["next", "terminated"][:, 0], away <= 3)
    assert torch.equal(m[away <= 3], away[away <= 3].long())
    torch.testing.assert_close(batch["next", "reward"][:, 0], -(1 - GAMMA ** torch.where(away <= 3, m - 1, m)) / 0.1)
    assert torch.equal(batch["next", "terminated"] & ~batch["next", "done"], torch.zeros(1000, 1, dtype=torch.bool))


def test_the_recorded_end_stays_where_nobody_asked():
    data = episodes(2, 8)
    data["next", "terminated"][:, -1] = True
    buffer = EpisodeReplay(100, 500, hindsight=HINDSIGHT, gamma=GAMMA)
    buffer.extend(data)
    batch = buffer.sample()
    assert torch.equal(batch["next", "terminated"][:, 0], batch["observation"][:, 1] == 7)


def test_padding_is_no_step():
    data = episodes(3, 10)
    mask = torch.arange(10) < torch.tensor([[10], [4], [1]])
    buffer = EpisodeReplay(100, 1000, hindsight=HINDSIGHT, steps=2, gamma=GAMMA)
    for shape in ((3, 10), (3, 10, 1)):
        buffer.extend(data.copy().set(("collector", "mask"), mask.reshape(shape)))
    assert len(buffer) == 2 * 15
    batch = buffer.sample()
    longest = torch.tensor([10.0, 4.0, 1.0])[batch["observation"][:, 0].long()]
    assert (batch["next", "observation"][:, 1] <= longest).all()
    goal = batch["desired_goal"][:, 0]
    assert ((goal <= longest) | (goal > 1e5)).all()


def test_steps_left_counts_to_the_nearest_end():
    done = torch.tensor([[False, True, False, False], [False, False, False, True]])
    mask = torch.tensor([[True, True, True, True], [True, True, False, False]])
    assert steps_left(done, mask)[mask].tolist() == [1, 0, 1, 0, 1, 0]
    assert steps_left(done[0], mask[0]).tolist() == [1, 0, 1, 0]


def test_demonstrations_keep_their_share():
    buffer = EpisodeReplay(50, 100, demonstrations=0.25, gamma=GAMMA)
    with pytest.raises(ValueError, match="empty"):
        buffer.sample()
    shown = copy.deepcopy(buffer)
    shown.extend_demonstrations(episodes(2, 5, first=10))
    assert (shown.sample()["observation"][:, 0] >= 10).all()
    buffer.extend(episodes(2, 5))
    assert (buffer.sample()["observation"][:, 0] < 10).all()
    buffer.extend_demonstrations(episodes(2, 5, first=10))
    for _ in range(20):
        buffer.extend(episodes(2, 5))
    batch = buffer.sample()
    assert (batch["observation"][:, 0] >= 10).sum() == 25
    assert batch.batch_size == (100,)
    assert len(buffer) == 50


def test_another_buffer_goes_on_where_the_first_was_saved():
    first, second = (
        EpisodeReplay(50, 64, hindsight=HINDSIGHT, steps=2, demonstrations=0.5, gamma=GAMMA) for _ in range(2)
    )
    first.extend(episodes(4, 17, length=6))
    first.extend_demonstrations(episodes(2, 7))
    second.load_state_dict(copy.deepcopy(first.state_dict()))
    samples = []
    for buffer in (first, second):
        torch.manual_seed(3)
        buffer.extend(episodes(1, 9, first=20))
        samples.append([buffer.sample() for _ in range(5)])
    for one, other in zip(*samples, strict=True):
        assert sorted(map(str, one.keys(True, True))) == sorted(map(str, other.keys(True, True)))
        assert (one == other).all()
    with pytest.raises(BadInput, match="size 50"):
        EpisodeReplay(60, 64, gamma=GAMMA).load_state_dict(first.state_dict())


def test_keys_go_by_any_name():
    data = episodes(2, 6)
    data.rename_key_("desired_goal", ("task", "goal"))
    data["next"].rename_key_("desired_goal", ("task", "goal"))
    data["next"].rename_key_("achieved_goal", "tip")
    data["next"].rename_key_("reward", "gain")
    hindsight = Hindsight(reward, achieved_key="tip", desired_key=("task", "goal"))
    buffer = EpisodeReplay(50, 64, hindsight=hindsight, reward_key="gain", gamma=GAMMA)
    buffer.extend(data)
    batch = buffer.sample()
    assert torch.equal(batch["task", "goal"], batch["next", "task", "goal"])
    assert (batch["task", "goal"] < 1e5).any()
    assert (batch["next", "gain"] > -7).any()
    with pytest.raises(BadInput, match="reward"):
        EpisodeReplay(50, 64, hindsight=hindsight, gamma=GAMMA).extend(data)


def test_the_first_batch_says_which_keys_are_kept():
    buffer = EpisodeReplay(50, 8, gamma=GAMMA)
    buffer.extend(episodes(2, 6))
    buffer.extend_demonstrations(episodes(2, 6).set("theta", torch.zeros(2, 6, 1)))
    assert buffer.sample().get("theta", None) is None
    with pytest.raises(BadInput, match="action"):
        buffer.extend(episodes(2, 6).exclude("action"))


def test_one_row_is_an_episode():
    buffer = EpisodeReplay(50, 64, gamma=GAMMA)
    buffer.extend(episodes(1, 6)[0])
    assert len(buffer) == 6
    assert buffer.sample(3).batch_size == (3,)


def test_steps_that_lead_elsewhere_come_as_often_as_is_asked() -> None:
    """Of two episodes of five steps, the object of the second moves at its third step."""
    data = episodes(2, 5)
    data["next", "achieved_goal"] = torch.zeros(2, 5, 1)
    data["next", "achieved_goal"][1, 2:] = 1.0
    left = steps_left(data["next", "done"][..., 0], torch.ones(2, 5, dtype=torch.bool))
    flags = leads_elsewhere(data["next", "achieved_goal"], left, reward)
    assert flags.tolist() == [[False] * 5, [True, True, False, False, False]]
    buffer = EpisodeReplay(100, 1000, hindsight=Hindsight(reward, elsewhere=0.6), gamma=GAMMA)
    buffer.extend(data)
    episode, step = buffer.sample()["observation"].unbind(-1)
    share = float(((episode == 1) & (step < 2)).float().mean())
    # .6 from the two steps, of the others as many as chance gives: binomial, standard deviation .013.
    assert abs(share - (0.6 + 0.4 * 0.2)) < 0.06
