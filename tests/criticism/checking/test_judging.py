"""The statistics of a check on numbers alone: rates of false alarms, power, and which change is named."""

from __future__ import annotations

import torch
from torch import Tensor

from onlinebayes.criticism.checking.held import Scores
from onlinebayes.criticism.checking.judging import Reference, error_rise, strongest

FREE = (torch.full((3,), -10.0, dtype=torch.float64), torch.full((3,), 10.0, dtype=torch.float64))
NOTHING = torch.zeros(2, 2, dtype=torch.float64)


def columns(windows: int, draw: torch.Generator) -> Tensor:
    """Three changes in windows of 20 rows, the last two of which do nearly the same."""
    found = torch.randn(windows, 20, 3, generator=draw, dtype=torch.float64)
    found[..., 2] = found[..., 1] + 0.03 * found[..., 2]
    return found


def scores(
    runs: int, draw: torch.Generator, size: tuple[float, float, float] = (0.0, 0.0, 0.0), spread: float = 0.0
) -> tuple[Scores, Tensor]:
    """Of runs of 4 windows: noise, a change in all of them, and one of its own in each run."""
    c = columns(4 * runs, draw)
    of = torch.arange(4 * runs) // 4
    own = torch.tensor(size, dtype=torch.float64) + spread * torch.randn(runs, 3, generator=draw, dtype=torch.float64)
    r = torch.randn(4 * runs, 20, generator=draw, dtype=torch.float64) + torch.einsum("wmc,wc->wm", c, own[of])
    return Scores(torch.einsum("wmc,wm->wc", c, r), c.mT @ c), of


def alarms(count: int, spread: float) -> int:
    """Out of so many checks of a machine that differs from run to run no more than before."""
    found = 0
    for seed in range(count):
        draw = torch.Generator().manual_seed(seed)
        reference = Reference.of(*scores(8, draw, spread=spread), NOTHING)
        new, run = scores(1 + seed % 4, draw, spread=spread)
        found += strongest(reference, new, run, run, FREE, 0.05) is not None
    return found


def test_false_alarms_are_no_more_than_said() -> None:
    # 400 checks at 5 %: at most 34 with probability 0.999 where the rate is 5 %.
    assert alarms(400, 0.0) <= 34
    assert alarms(400, 0.3) <= 34


def test_a_change_is_found_and_so_is_what_does_the_same() -> None:
    draw = torch.Generator().manual_seed(0)
    reference = Reference.of(*scores(8, draw), NOTHING)
    new, run = scores(3, draw, (0.0, 1.0, 0.0))
    found = strongest(reference, new, run, run, FREE, 0.005)
    assert found is not None
    assert found.change in (1, 2)
    assert found.alike == (3 - found.change,)
    assert abs(found.size - 1.0) < 5 * found.sd + 0.02
    assert found.stretch == 0
    assert found.p < 1e-3


def test_a_change_is_dated() -> None:
    draw = torch.Generator().manual_seed(1)
    reference = Reference.of(*scores(8, draw), NOTHING)
    before, _ = scores(3, draw)
    after, _ = scores(3, draw, (1.0, 0.0, 0.0))
    run = torch.arange(24) // 4
    both = Scores(torch.cat([before.u, after.u]), torch.cat([before.J, after.J]))
    found = strongest(reference, both, run, run, FREE, 0.005)
    assert found is not None
    assert (found.change, found.stretch) == (0, 3)


def test_bounds_hold_a_size() -> None:
    draw = torch.Generator().manual_seed(2)
    reference = Reference.of(*scores(8, draw), NOTHING)
    new, run = scores(3, draw, (-1.0, 0.0, 0.0))
    never_less = (FREE[0] * torch.tensor([0.0, 1.0, 1.0], dtype=torch.float64), FREE[1])
    found = strongest(reference, new, run, run, never_less, 0.005)
    assert found is None or found.change != 0


def test_an_error_that_the_parameters_had_is_no_change() -> None:
    """Where the fit left a number known to 1 only, new logs that lean on it otherwise may show as much."""
    draw = torch.Generator().manual_seed(3)
    sure, part = scores(8, draw)
    new, run = scores(3, draw)
    lean = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    new.J[:, 2, 0] = new.J[:, 0, 2] = 0.8 * new.J[:, 0, 0]  # an error of the first shows in the third now
    shifted = Scores(new.u + 0.8 * new.J[:, 0, :1] * lean, new.J)
    known, unknown = (Reference.of(sure, part, torch.eye(2, dtype=torch.float64) * sd**2) for sd in (1e-3, 1.0))
    assert strongest(known, shifted, run, run, FREE, 0.005) is not None
    assert strongest(unknown, shifted, run, run, FREE, 0.005) is None


def test_an_error_that_rises_is_seen_and_noise_is_not() -> None:
    draw = torch.Generator().manual_seed(4)
    found = 0
    for _ in range(200):
        old, new = (torch.randn(n, 20, generator=draw, dtype=torch.float64).square().sum(1) for n in (32, 12))
        found += error_rise(old, torch.arange(32) // 4, new, torch.arange(12) // 4)[1] < 0.05
    assert found <= 20  # of 200 at 5 %: more with probability 0.001
    ratio, p = error_rise(old, torch.arange(32) // 4, 4 * new, torch.arange(12) // 4)
    assert p < 1e-3
    assert 3 < ratio < 6
