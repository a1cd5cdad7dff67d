"""Epsilon-free inference against an exact posterior, and where its correction does not exist."""

from __future__ import annotations

import logging
from functools import partial

import pytest
import torch

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Box,
    BoxUniform,
    EpsilonFree,
    EpsilonFreeRun,
    TruncatedMixture,
    Uncorrectable,
    fit,
)
from onlinebayes.inference.proposals import TruncatedProposal
from onlinebayes.runs import BadInput
from tests.inference.systems import STEPS
from tests.inference.test_protocol import PRIOR, SPACE, simulate

SD = 0.2 / STEPS**0.5
"""Of the exact posterior, a Gaussian in the unit cube whose mean is the mean change of the observation."""

TRUTH = SPACE.from_unit(torch.tensor([[0.4, 0.6]], dtype=torch.float64))


def embedding(_: object) -> SummaryEmbedding:
    return SummaryEmbedding(TransitionFeatures(2, 1, products=False))


def sampler(prior: BoxUniform = PRIOR, epochs: int = 20, **more) -> EpsilonFree:
    train = partial(fit, epochs=epochs, batch_size=100, learning_rate=8e-3)
    return EpsilonFree(embedding, prior, simulate, train=train, **more)


def gaussian(mean: list[list[float]], sd: float) -> TruncatedMixture:
    lower = sd * torch.eye(2).double().expand(len(mean), 2, 2)
    return TruncatedMixture(torch.zeros(len(mean)).double(), torch.tensor(mean).double(), lower, Box.whole(SPACE))


def measured(seed: int, number: int = 1):
    data = simulate(TRUTH.expand(number, 2), torch.Generator().manual_seed(seed))
    return data.exclude("theta"), (data["next", "observation"] - data["observation"]).mean((0, 1))


def errors(run: EpsilonFreeRun, exact: torch.Tensor, sd: float = SD) -> tuple[torch.Tensor, torch.Tensor]:
    """Of the mean [exact standard deviations], and the standard deviations over the exact ones."""
    draws = SPACE.to_unit(run.belief.sample((10_000,), torch.Generator().manual_seed(0)))
    return ((draws.mean(0) - exact) / sd).abs(), draws.std(0) / sd


def finite(run: EpsilonFreeRun) -> bool:
    theta = run.belief.sample((500,), torch.Generator().manual_seed(0))
    return bool(PRIOR.contains(theta).all()) and bool(torch.isfinite(run.belief.log_prob(theta)).all())


def test_a_gaussian_posterior_is_found() -> None:
    """Mean within one standard deviation, width within a factor 1.7.

    Of 20 other seeds all passed, the worst with .66 of a standard deviation and a factor 1.4: at 95 % confidence a
    fresh seed fails in less than 14 % of cases.
    """
    data, exact = measured(0)
    run = sampler(rounds=2, simulations=1000, components=1).run(data, torch.Generator().manual_seed(0))
    off, ratio = errors(run, exact)
    assert [each.how for each in run.rounds] == ["prior", "corrected", "corrected"]
    assert run.simulations == 3000
    assert float(off.max()) < 1
    assert float(torch.log(ratio).abs().exp().max()) < 1.7


@pytest.mark.slow
def test_a_gaussian_posterior_is_found_by_a_mixture() -> None:
    """Over three seeds: root mean square error of the mean below .6 standard deviations, median width within a fifth.

    12 other seeds gave a root mean square error of .23, .77 at most, and widths between .81 and 1.22 of the exact one:
    a fresh set of three fails with a chance of about a thousandth.
    """
    found = []
    for seed in range(3):
        data, exact = measured(seed)
        found.append(errors(sampler(simulations=1000).run(data, torch.Generator().manual_seed(seed)), exact))
    assert float(torch.stack([off for off, _ in found]).square().mean().sqrt()) < 0.6
    assert float(torch.stack([ratio for _, ratio in found]).median()) == pytest.approx(1, abs=0.2)


def test_a_proposal_narrower_than_a_component_falls_back(caplog: pytest.LogCaptureFixture) -> None:
    """The first proposal has a fortieth of the posterior's width and lies 80 of its own off.

    Of 8 other seeds all passed, with an error of .99 standard deviations at most.
    """
    data, exact = measured(0)
    caplog.set_level(logging.INFO, logger="onlinebayes.inference.epsilon_free")
    run = sampler(rounds=3, simulations=300).run(
        data, torch.Generator().manual_seed(0), gaussian([[0.6, 0.4]], SD / 40)
    )
    used = [each.how for each in run.rounds]
    assert "refused" in used
    for before, after in zip(run.rounds[:-1], run.rounds[1:], strict=True):
        if before.how == "refused":
            assert isinstance(before.outcome, Uncorrectable)
            assert isinstance(after.proposal, TruncatedProposal)
            assert after.how == "truncated"
    assert finite(run)
    assert float(errors(run, exact)[0].max()) < 2
    assert len(caplog.messages) == len(used)
    for told, how in zip(caplog.messages, used, strict=True):
        assert how in told


def test_a_first_proposal_that_is_a_mixture_falls_back() -> None:
    data, exact = measured(0)
    start = gaussian([[0.3, 0.6], [0.5, 0.6]], 0.1)
    run = sampler(rounds=2, simulations=300, components=2).run(data, torch.Generator().manual_seed(0), start)
    assert [each.how for each in run.rounds[:2]] == ["refused", "truncated"]
    assert finite(run)
    assert float(errors(run, exact)[0].max()) < 2


@pytest.mark.parametrize("sd", [1e-4, 10.0])
def test_no_first_proposal_breaks_a_run(sd: float) -> None:
    """Far narrower than what is known and far outside of it; and all but flat."""
    data, _ = measured(0)
    run = sampler(rounds=2, simulations=60, epochs=3, components=3).run(
        data, torch.Generator().manual_seed(0), gaussian([[1.2, -0.3]], sd)
    )
    assert finite(run)


def test_a_prior_on_a_part_of_the_space_is_kept_to() -> None:
    data, _ = measured(0)
    part = BoxUniform(SPACE, Box(SPACE, torch.tensor([0.45, 0.3]).double(), torch.tensor([0.9, 0.8]).double()))
    run = sampler(part, rounds=2, simulations=100, epochs=5).run(data, torch.Generator().manual_seed(0))
    for each in run.rounds:
        assert part.contains(each.proposal.sample((200,), torch.Generator().manual_seed(1))).all()
    assert part.contains(run.belief.sample((200,), torch.Generator().manual_seed(1))).all()


def test_three_trajectories_multiply() -> None:
    """As for one; of 12 other seeds all passed, the worst with .73 and 1.18."""
    data, exact = measured(0, number=3)
    run = sampler(rounds=2, simulations=1000, components=1).run(data, torch.Generator().manual_seed(0))
    off, ratio = errors(run, exact, SD / 3**0.5)
    assert float(off.max()) < 1
    assert float(torch.log(ratio).abs().exp().max()) < 1.7


def test_a_seed_repeats_a_run() -> None:
    data, _ = measured(0)
    small = sampler(rounds=1, simulations=100, epochs=3)
    first, second, other = (small.run(data, torch.Generator().manual_seed(seed)) for seed in (2, 2, 3))
    assert torch.equal(first.belief.mean, second.belief.mean)
    assert not torch.equal(first.belief.mean[..., :1, :], other.belief.mean[..., :1, :])


def test_it_refuses_what_it_cannot_use() -> None:
    for wrong in ({"rounds": 0}, {"simulations": 5}, {"components": 0}):
        with pytest.raises(BadInput, match="needs one round, ten simulations and one component"):
            sampler(**wrong)
