"""The exact posteriors that studies compare with: ranks of the truth among their draws are uniform."""

from __future__ import annotations

import pytest
import torch
from scipy.stats import kstest

from onlinebayes.inference import BoxUniform
from recipes.studies.known_tasks import TASKS, KnownTask


def ranks(task: KnownTask, thetas: int, draws: int, generator: torch.Generator) -> torch.Tensor:
    """Share of draws below the truth, parameter by parameter, with a part of a step at random."""
    truth = BoxUniform(task.space).sample((thetas,), generator)
    measured = task.simulate(truth, generator)
    found = [(task.draw(x, draws, generator) < theta).sum(0) for x, theta in zip(measured, truth, strict=True)]
    jitter = torch.rand(thetas, len(task.space), generator=generator)
    return (torch.stack(found) + jitter) / (draws + 1)


SLOW = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "thetas"),
    [("linear Gaussian, 2", 300), ("Gaussian mixture", 300), ("two moons", 300), pytest.param("SLCP", 40, marks=SLOW)],
)
def test_ranks_are_uniform(name: str, thetas: int) -> None:
    generator = torch.Generator().manual_seed(0)
    for column in ranks(TASKS[name], thetas, 60, generator).T:
        # One in a thousand would fail, and the seed is fixed.
        assert kstest(column.numpy(), "uniform").pvalue > 1e-3


def test_draws_lie_in_the_box() -> None:
    generator = torch.Generator().manual_seed(1)
    for name in ("linear Gaussian, 10", "edge", "Gaussian mixture", "two moons"):
        task = TASKS[name]
        truth = BoxUniform(task.space).sample((1,), generator)
        assert task.space.contains(task.draw(task.simulate(truth, generator)[0], 200, generator)).all()


def test_the_other_crescent_is_drawn_too() -> None:
    generator = torch.Generator().manual_seed(2)
    task = TASKS["two moons"]
    theta = task.draw(torch.tensor([0.0, 0.0]).double(), 400, generator)
    share = float((theta.sum(-1) > 0).double().mean())
    # Five standard errors of 400.
    assert abs(share - 0.5) < 0.125
