"""Hypotheses about when a machine changed, and the belief over them, against an exact filter on a grid."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.inference import Box, BoxUniform, ChangingBelief, Hazard, History, RunLengths, TruncatedMixture
from onlinebayes.inference.distributions.algebra import log_overlap, product, stepped, weighed
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput

SPACE = ParameterSpace({"mass": Parameter(0.0, 2.0, "kg")})
SD = 0.03
"""Of a trajectory's one number about u, theta in the unit cube."""


class Exact:
    """An estimator of the mean of Gaussian numbers: its posteriors are known."""

    def __init__(self, box: Box | None = None) -> None:
        self.space, self.box = SPACE, box if box is not None else Box.whole(SPACE)

    def fit(self, simulations, groups=None, *, generator):
        raise NotImplementedError

    def each(self, groups: TensorDict) -> TruncatedMixture:
        raise NotImplementedError

    def condition(self, trajectories: TensorDict) -> TruncatedMixture:
        seen = trajectories["observation"][..., 0].double().mean(1)
        width = self.box.high - self.box.low
        mean, sd = (seen.mean() - self.box.low) / width, SD / math.sqrt(len(seen)) / width
        return TruncatedMixture(torch.zeros(1).double(), mean[None], sd[None, None], self.box)


def trajectories(u: list[float]) -> TensorDict:
    """One of a single step for each number."""
    seen = torch.tensor(u, dtype=torch.float64)[:, None, None]
    return TensorDict({"observation": seen, "action": 0 * seen, "next": {"observation": seen}}, [len(u), 1])


def noisy(u: list[float], seed: int) -> TensorDict:
    noise = SD * torch.randn(len(u), generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return trajectories((torch.tensor(u, dtype=torch.float64) + noise).tolist())


def exact(u: list[float], hazard: Hazard, z: torch.Tensor) -> torch.Tensor:
    """Density of theta after the last number, by filtering on the grid z."""
    width = float(z[1] - z[0])
    kernel = torch.exp(-0.5 * ((z[:, None] - z) / hazard.step).square())
    step = kernel / (kernel.sum(1, keepdim=True) * width)
    p = torch.ones_like(z)
    for t, seen in enumerate(u):
        if t:
            moved = hazard.small * (p @ step) * width + (1 - hazard.small)
            p = (1 - hazard.rate) * p + hazard.rate * moved
        p = p * torch.exp(-0.5 * ((z - seen) / SD).square())
        p = p / (p.sum() * width)
    return p


def test_the_overlap_is_the_integral_of_the_product():
    space = ParameterSpace({"a": Parameter(0.0, 1.0), "b": Parameter(0.0, 1.0)})
    g = torch.Generator().manual_seed(1)

    def mixture() -> TruncatedMixture:
        lower = 0.1 * torch.eye(2).double() + 0.05 * torch.tril(torch.rand(3, 2, 2, generator=g).double())
        return TruncatedMixture(
            torch.randn(3, generator=g).double(), torch.rand(3, 2, generator=g).double(), lower, Box.whole(space)
        )

    first, second = mixture(), mixture()
    line = (torch.arange(400).double() + 0.5) / 400
    z = torch.cartesian_prod(line, line)
    both = first.log_prob_frame(z) + second.log_prob_frame(z)
    assert float(log_overlap(first, second)) == pytest.approx(float(both.exp().mean().log()), abs=1e-3)
    # What the product has to be divided by to be normalised.
    assert torch.allclose(product([first, second]).log_prob_frame(z), both - log_overlap(first, second), atol=1e-3)


def test_a_batch_of_overlaps_is_the_overlap_of_each():
    lower = torch.tensor([0.1, 0.3])[:, None, None, None].double()
    mixtures = TruncatedMixture(torch.zeros(2, 1).double(), torch.rand(2, 1, 1).double(), lower, Box.whole(SPACE))
    both = log_overlap(mixtures, mixtures)
    assert torch.allclose(both, torch.stack([log_overlap(mixtures[i], mixtures[i]) for i in range(2)]))


def test_a_step_adds_its_variance():
    narrow = TruncatedMixture(
        torch.zeros(1).double(),
        torch.full((1, 1), 0.5).double(),
        torch.full((1, 1, 1), 0.03).double(),
        Box.whole(SPACE),
    )
    assert float(stepped(narrow, 0.04).scale_tril) == pytest.approx(0.05)


def test_weighed_is_the_mixture_of_the_densities():
    a, b = (Exact().condition(trajectories([u])) for u in (0.01, 0.6))  # the first leans over an edge
    z = torch.linspace(0.001, 0.999, 50).double()[:, None]
    want = 0.25 * a.log_prob_frame(z).exp() + 0.75 * b.log_prob_frame(z).exp()
    assert torch.allclose(weighed([a, b], [math.log(0.25), math.log(0.75)]).log_prob_frame(z).exp(), want)


@pytest.mark.parametrize("jump", [0.0, 0.1, 0.4])
def test_the_belief_is_the_exact_filter_s(jump):
    hazard = Hazard(rate=0.05, step=0.1, keep=16)
    u = [0.4, 0.43, 0.38, 0.41 + jump, 0.39 + jump, 0.42 + jump]
    belief = ChangingBelief(Exact(), hazard).update(trajectories(u))
    z = (torch.arange(2000).double() + 0.5) / 2000
    want = exact(u, hazard, z)
    found = belief.distribution.log_prob_frame(z[:, None]).exp()
    assert float((found - want).abs().mean()) < 0.01  # half of it is the total variation
    assert float(want @ z / 2000) == pytest.approx(float(found @ z / 2000), abs=1e-3)


def test_in_turns_or_at_once_it_is_the_same():
    data = noisy([0.3] * 3 + [0.7] * 2, 0)
    once = ChangingBelief(Exact()).update(data)
    turns = ChangingBelief(Exact()).update(data[:2]).update(data[2:])
    theta = SPACE.from_unit(torch.rand(20, 1).double())
    assert torch.equal(once.log_prob(theta), turns.log_prob(theta))
    assert once.changes == turns.changes
    taken_up = ChangingBelief(Exact(), history=turns.history, seen=data)
    assert torch.allclose(taken_up.log_prob(theta), turns.log_prob(theta))
    shorter = ChangingBelief(Exact(), history=turns.history, seen=data[-len(turns.seen) :])
    assert torch.allclose(shorter.log_prob(theta), turns.log_prob(theta))


def test_trajectories_of_other_lengths_stand_beside_each_other():
    long = torch.cat([noisy([0.3], 3), noisy([0.3], 4)], dim=1)
    belief = ChangingBelief(Exact()).update(noisy([0.3], 1)).update(long)
    assert belief.seen.shape == (2, 2)
    assert belief.seen["mask"].tolist() == [[True, False], [True, True]]


def test_a_change_is_said_and_followed():
    belief = ChangingBelief(Exact()).update(noisy([0.3] * 4 + [0.7] * 3, 5))
    assert [change.after for change in belief.changes] == [4]
    assert belief.changes[0].probability > 0.95
    assert "the machine changed after trajectory 4 (probability 0." in belief.in_words()
    mean = belief.sample((2000,), torch.Generator().manual_seed(0)).mean()
    assert abs(float(mean) - 1.4) < 4 * 2 * SD / math.sqrt(3)
    assert len(belief.seen) == 3  # what was before is needed no more


def test_no_change_costs_nearly_nothing():
    data = noisy([0.3] * 10, 6)
    belief, plain = ChangingBelief(Exact()).update(data), Exact().condition(data)
    assert not belief.changes
    assert "one machine made all 10 trajectories" in belief.in_words()
    middle = torch.tensor([0.025, 0.975]).double()
    wide, exact = (
        torch.quantile(one.sample((20_000,), torch.Generator().manual_seed(0)), middle, 0).diff(dim=0)
        for one in (belief, plain)
    )
    assert float(wide / exact) < 1.05


@pytest.mark.slow
def test_few_false_alarms():
    """Of 20 runs of 30 at most 1 may be called changed."""
    called = sum(bool(ChangingBelief(Exact()).update(noisy([0.2 + 0.03 * i] * 30, i)).changes) for i in range(20))
    assert called <= 1


def test_a_trajectory_across_the_change_fits_neither_side():
    belief = ChangingBelief(Exact()).update(noisy([0.2] * 4 + [0.5] + [0.8] * 3, 7))
    (change,) = belief.changes
    assert change.within
    assert change.after == 4
    assert change.since == 5
    assert "in trajectory 5" in belief.in_words()
    assert "fits neither side" in belief.in_words()


def test_a_second_change_is_said_beside_the_first():
    belief = ChangingBelief(Exact()).update(noisy([0.2] * 4 + [0.5] * 4 + [0.8] * 4, 8))
    assert [(change.after, change.within) for change in belief.changes] == [(4, False), (8, False)]


def test_what_was_read_long_ago_is_kept_as_a_density():
    data = noisy([0.3] * 6, 9)
    whole, folded = (ChangingBelief(Exact(), Hazard(together=n)).update(data) for n in (60, 1))
    theta = SPACE.from_unit(torch.linspace(0.25, 0.35, 9).double()[:, None])
    assert torch.allclose(whole.log_prob(theta), folded.log_prob(theta), atol=1e-2)
    assert len(folded.seen) == 0
    moved = ChangingBelief(Exact(), Hazard(together=3)).update(noisy([0.3] * 5 + [0.6] * 4, 10))
    assert [change.after for change in moved.changes] == [5]


def test_another_estimator_takes_it_up_in_another_box():
    data, box = noisy([0.3] * 4, 11), Box(SPACE, torch.tensor([0.2]).double(), torch.tensor([0.5]).double())
    before = ChangingBelief(Exact()).update(data)
    after = ChangingBelief(Exact(box), history=before.history, seen=data)
    theta = SPACE.from_unit(torch.tensor([[0.28], [0.31]]).double())
    assert torch.allclose(before.log_prob(theta), after.log_prob(theta), atol=0.01)
    assert torch.equal(after.box.low, box.low)


def test_more_rings_than_chance_are_an_effect_that_the_model_lacks():
    history = ChangingBelief(Exact()).update(noisy([0.3] * 6, 12)).history
    assert "lacks an effect" in replace(history, novelty=(0.01, 0.4, 0.02, 0.04, 0.7, 0.01)).in_words()
    assert "one machine" in replace(history, novelty=(0.01, 0.4, 0.3, 0.2, 0.7, 0.9)).in_words()
    changed = ChangingBelief(Exact()).update(noisy([0.3] * 3 + [0.7] * 3, 13)).history
    either = replace(changed, novelty=(0.01, 0.4, 0.02, 0.04, 0.7, 0.01)).in_words()
    assert "either the model lacks an effect, or the machine changed after trajectory 3" in either


def test_before_any_trajectory_it_is_the_prior():
    belief, prior = ChangingBelief(Exact()), BoxUniform(SPACE)
    theta = torch.tensor([[0.5], [3.0]]).double()
    assert torch.equal(belief.log_prob(theta), prior.log_prob(theta))
    assert belief.in_words() == "no trajectory yet"
    assert belief.changes == ()


def test_probabilities_sum_to_one():
    lengths = ChangingBelief(Exact()).update(noisy([0.3] * 3 + [0.5] * 2, 14)).history.lengths
    assert lengths.number == 5
    assert lengths.changed(0) == pytest.approx(1)
    assert lengths.since == 3


@pytest.mark.parametrize("wrong", [{"rate": 0.0}, {"small": 1.0}, {"step": 0.0}, {"keep": 2}, {"together": 0}])
def test_a_hazard_that_is_none_is_refused(wrong):
    with pytest.raises(BadInput, match="needs 0 < rate < 1"):
        Hazard(**wrong)


def test_a_history_without_its_trajectories_is_refused():
    belief = ChangingBelief(Exact()).update(noisy([0.3] * 3, 15))
    with pytest.raises(BadInput, match="give the newest 3 at least"):
        ChangingBelief(Exact(), history=belief.history, seen=belief.seen[1:])
    with pytest.raises(BadInput, match="3 trajectories beside 0"):
        ChangingBelief(Exact(), history=belief.history)
    assert History(RunLengths(Hazard())).in_words() == "no trajectory yet"
