"""A belief in a space that has grown: the old parameters as they were, of the new ones nothing."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.inference import Box, BoxUniform, TruncatedMixture, extended
from onlinebayes.inference.saving import from_state, to_state
from onlinebayes.parameters import Parameter, ParameterSpace

OLD = ParameterSpace({"mass": Parameter(0.1, 1.0, "kg"), "length": Parameter(0.1, 1.0, "m", "log")})
NEW = OLD | ParameterSpace({"friction": Parameter(0.0, 4.0, "N m"), "delay": Parameter(0.0, 0.2, "s")})


def mixture() -> TruncatedMixture:
    mean = torch.tensor([[0.3, 0.4], [0.9, 0.2]], dtype=torch.float64)
    lower = torch.tensor([[[0.1, 0.0], [0.05, 0.2]], [[0.2, 0.0], [0.0, 0.1]]], dtype=torch.float64)
    low, high = torch.tensor([0.1, 0.0]).double(), torch.tensor([0.8, 1.0]).double()
    return TruncatedMixture(torch.tensor([0.0, 1.0]).double(), mean, lower, Box(OLD, low, high))


def test_a_box_gets_further_sides() -> None:
    box = Box(OLD, torch.tensor([0.25, 0.5]).double(), torch.tensor([0.5, 0.75]).double())
    grown = extended(BoxUniform(OLD, box), NEW)
    assert isinstance(grown, BoxUniform)
    assert grown.box.low.tolist() == [0.25, 0.5, 0.0, 0.0]
    assert grown.box.high.tolist() == [0.5, 0.75, 1.0, 1.0]


def test_a_mixture_keeps_what_it_knows_and_says_nothing_of_the_rest() -> None:
    """Density of the product to 3 % (the flat Gaussian is flat to 1 %); moments of 20,000 draws within 5 s.e."""
    old = mixture()
    grown = extended(old, NEW)
    theta = NEW.from_unit(torch.rand(50, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64))
    inside = old.box.contains(theta[:, :2])
    expected = old.log_prob(theta[:, :2])[inside] - torch.log(torch.tensor(4.0 * 0.2))
    torch.testing.assert_close(grown.log_prob(theta)[inside], expected.double(), atol=0.03, rtol=0)
    draws = grown.sample((20_000,), torch.Generator().manual_seed(1))
    same = old.sample((20_000,), torch.Generator().manual_seed(2))
    error = (draws[:, :2].mean(0) - same.mean(0)).abs() / (same.std(0) * (2 / 20_000) ** 0.5)
    assert (error < 5).all()
    u = NEW.to_unit(draws)[:, 2:]
    assert ((u.mean(0) - 0.5).abs() < 5 * 0.29 / 20_000**0.5).all()
    again = from_state(NEW, to_state(grown))
    torch.testing.assert_close(again.log_prob(theta), grown.log_prob(theta))


def test_a_space_that_does_not_begin_alike_is_refused() -> None:
    other = ParameterSpace({name: NEW[name] for name in reversed(NEW.names)})
    with pytest.raises(ValueError, match="has to begin with these"):
        extended(mixture(), other)
