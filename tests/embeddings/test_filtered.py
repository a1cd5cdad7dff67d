"""A filter through the simulator gives what least squares over the whole trajectory gives, where all is linear."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding, Rows, SimulatorFilter
from onlinebayes.embeddings.likeliest import DISTURBED, STRAIGHT, Levels
from onlinebayes.inference import Box
from onlinebayes.parameters import ParameterSpace
from tests import slide
from tests.slide import STEPS, Slide

SPACE = ParameterSpace({"gain": Slide.physical["gain"]})
NOISE = torch.tensor([0.02, 0.05], dtype=torch.float64)


def embedding(levels: Levels = DISTURBED) -> FilteredEmbedding:
    model = SimulatorFilter(
        Slide(SPACE), Box.whole(SPACE), 2, state=slide.state, command=lambda a: a, observe=slide.observe
    )
    return FilteredEmbedding(model, 1, levels).double()


def measured(theta: Tensor, seed: int) -> tuple[Tensor, Tensor, Tensor]:
    """Noisy observation, action, next observation (B, T, .)."""
    seen, action = slide.measured(SPACE, theta, NOISE, torch.Generator().manual_seed(seed))
    return seen[:, :-1].clone(), action, seen[:, 1:].clone()


def exact(seen: Tensor, action: Tensor) -> tuple[float, float]:
    """z of one trajectory (T + 1, 2) by least squares, and its variance."""
    information, pull = slide.least_squares(SPACE, seen, action, NOISE)
    return float(pull / information), float(1 / information)


@pytest.mark.parametrize("levels", [DISTURBED, STRAIGHT])
def test_on_a_linear_system_it_is_exact(levels: Levels) -> None:
    theta = torch.linspace(0.8, 2.2, 8, dtype=torch.float64)[:, None]
    observation, action, following = measured(theta, seed=0)
    made = embedding(levels)
    made.model.noise.copy_(NOISE)
    features, mask = made.features(observation, action, following), torch.ones(8, STEPS, dtype=torch.bool)
    alone = made.encode(features, mask)[:, -2:]
    pairs = made.encode_set(features.unflatten(0, (4, 2)), mask.unflatten(0, (4, 2)))[:, -2:]
    seen = torch.cat([observation[:, :1], following], dim=1)
    truths = [exact(seen[b], action[b]) for b in range(8)]
    for b, (z, variance) in enumerate(truths):
        assert float(alone[b, 0]) == pytest.approx(z, abs=1e-4)
        # The flat belief, five boxes wide, counts as one row more.
        assert float(alone[b, 1]) ** -2 == pytest.approx(1 / variance + 0.04, rel=1e-4)
    # Two trajectories of a set say together what their weighted mean says.
    for g, ((z, variance), (other, its)) in enumerate(zip(truths[::2], truths[1::2], strict=True)):
        assert float(pairs[g, 0]) == pytest.approx((z / variance + other / its) / (1 / variance + 1 / its), abs=1e-4)
        assert float(pairs[g, 1]) ** -2 == pytest.approx(1 / variance + 1 / its + 0.04, rel=1e-4)


def test_the_likelihood_is_that_of_the_whole_trajectory() -> None:
    observation, action, following = measured(torch.tensor([[1.5]]).double(), seed=4)
    made = embedding()
    made.model.noise.copy_(NOISE)
    many = 5
    rows = made.rows(made.features(observation, action, following), torch.ones(1, STEPS, dtype=torch.bool))
    grid = torch.linspace(0.3, 0.7, many, dtype=torch.float64)[:, None]
    found = made.model.log_likelihood(Rows(*(part.expand(many, *part.shape[1:]) for part in rows)), grid)
    z, variance = exact(torch.cat([observation[:, :1], following], dim=1)[0], action[0])
    parabola = -0.5 * (grid[:, 0] - z).square() / variance
    torch.testing.assert_close(found - found[0], parabola - parabola[0], rtol=1e-4, atol=1e-4)


def test_a_set_does_not_depend_on_its_order_or_its_padding() -> None:
    theta = torch.full((3, 1), 1.2, dtype=torch.float64)
    made = embedding()
    made.model.noise.copy_(NOISE)
    rows = made.features(*measured(theta, seed=5))[None]
    mask = torch.ones(1, 3, STEPS, dtype=torch.bool)
    together = made.encode_set(rows, mask)
    order = torch.tensor([2, 0, 1])
    torch.testing.assert_close(made.encode_set(rows[:, order], mask[:, order]), together, rtol=1e-6, atol=1e-6)
    empty = torch.cat([rows, torch.full_like(rows[:, :1], 0.3)], dim=1)
    none = torch.cat([mask, torch.zeros_like(mask[:, :1])], dim=1)
    torch.testing.assert_close(made.encode_set(empty, none), together, rtol=1e-6, atol=1e-6)


def test_the_noise_is_read_off_the_simulations() -> None:
    draw = torch.Generator().manual_seed(1)
    theta = SPACE.from_unit(torch.rand(200, 1, dtype=torch.float64, generator=draw))
    made = embedding()
    made.fit(*measured(theta, seed=2), torch.ones(200, STEPS, dtype=torch.bool))
    # The median of a hundred means of twenty squares: a few per cent, and the median of a skew distribution lies below.
    torch.testing.assert_close(made.model.noise, NOISE, rtol=0.15, atol=0)


def test_padding_is_not_read() -> None:
    theta = torch.linspace(0.8, 2.2, 6, dtype=torch.float64)[:, None]
    observation, action, following = measured(theta, seed=3)
    mask = torch.arange(STEPS) < torch.tensor([20, 12, 7, 3, 1, 0])[:, None]
    made = embedding()
    made.fit(observation, action, following, mask)
    short = made(observation, action, following, mask)
    for rows in (observation, action, following):
        rows[~mask] = float("nan")
    assert torch.equal(made(observation, action, following, mask), short)
    alone = made(observation[2:3, :7], action[2:3, :7], following[2:3, :7])
    torch.testing.assert_close(alone, short[2:3])
    told = short[-1, :-2]
    assert bool((told == 0).all())


@pytest.mark.gpu
def test_on_a_gpu_it_gives_the_same() -> None:
    theta = torch.linspace(0.8, 2.2, 8, dtype=torch.float64)[:, None]
    data, mask, found = measured(theta, seed=0), torch.ones(8, STEPS, dtype=torch.bool), {}
    for device in ("cpu", "cuda"):
        model = SimulatorFilter(
            Slide(SPACE, device=device), Box.whole(SPACE), 2,
            state=slide.state, command=lambda a: a, observe=slide.observe,
        )  # fmt: skip
        made = FilteredEmbedding(model, 1).double()
        assert made.device.type == device
        values = (*(x.to(device) for x in data), mask.to(device))
        made.fit(*values)
        found[device] = made(*values)
        assert found[device].device.type == device
    torch.testing.assert_close(found["cuda"].cpu(), found["cpu"], rtol=1e-6, atol=1e-6)
