from __future__ import annotations

import copy

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule

from onlinebayes.objectives.normalisation import RunningNormalization


def test_batches_give_the_statistics_of_all_rows_together():
    rows = torch.tensor([3.0, 100.0, 0.0]) + torch.tensor([2.0, 0.1, 0.0]) * torch.randn(1000, 3)
    normaliser = RunningNormalization(3)
    for part in rows.split([1, 299, 500, 200]):
        normaliser.observe(part.reshape(1, -1, 3))
    torch.testing.assert_close(normaliser.mean, rows.mean(0))
    torch.testing.assert_close(normaliser.variance, rows.var(0, correction=0), rtol=1e-3, atol=1e-6)
    assert normaliser.count == 1000
    out = normaliser(rows)
    torch.testing.assert_close(out.mean(0), torch.zeros(3), atol=1e-3, rtol=0)
    torch.testing.assert_close(out[:, :2].std(0), torch.ones(2), atol=1e-2, rtol=0)
    assert not out[:, 2].any(), "a constant column is 0"


def test_one_batch_equals_many():
    rows = torch.randn(64, 2, dtype=torch.float64)
    once, often = (RunningNormalization(2, dtype=torch.float64) for _ in range(2))
    once.observe(rows)
    for row in rows:
        often.observe(row)
    torch.testing.assert_close(once.state_dict(), often.state_dict())


def test_calling_it_learns_nothing_and_clips():
    normaliser = RunningNormalization(1, clip=2.0)
    torch.testing.assert_close(normaliser(torch.tensor([[-9.0], [0.5], [9.0]])), torch.tensor([[-2.0], [0.5], [2.0]]))
    assert normaliser.count == 0


def test_several_keys_stand_side_by_side_in_one_module():
    normaliser = RunningNormalization(3)
    module = TensorDictModule(normaliser, ["observation", ("goal", "place")], ["features"])
    data = TensorDict({"observation": torch.randn(5, 2), ("goal", "place"): torch.randn(5, 1) + 7}, (5,))
    normaliser.observe(data["observation"], data["goal", "place"])
    assert module(data)["features"].shape == (5, 3)
    assert module(data)["features"].mean().abs() < 1e-6


def test_statistics_are_saved():
    normaliser = RunningNormalization(2)
    normaliser.observe(torch.randn(10, 2) + 3)
    other = RunningNormalization(2)
    other.load_state_dict(copy.deepcopy(normaliser.state_dict()))
    for each in (normaliser, other):
        each.observe(torch.ones(3, 2))
    assert all(torch.equal(a, b) for a, b in zip(normaliser.buffers(), other.buffers(), strict=True))


def test_rows_that_are_no_numbers_are_left_out():
    normaliser = RunningNormalization(3)
    rows = torch.randn(10, 3)
    normaliser.observe(rows)
    before = copy.deepcopy(normaliser.state_dict())
    normaliser.observe(torch.tensor([[0.0, torch.nan, 0.0], [torch.inf, 0.0, 0.0]]))
    normaliser.observe(torch.empty(0, 3))
    torch.testing.assert_close(normaliser.state_dict(), before, rtol=0, atol=0)
