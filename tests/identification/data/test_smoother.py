from dataclasses import replace

import pytest
import torch

from onlinebayes.identification.data.grid import RunGrid
from onlinebayes.identification.data.smoother import half_window, local_cubic

H = 0.01


def grid(value: torch.Tensor) -> RunGrid:
    rows = len(value)
    zero = torch.zeros(rows, 1, dtype=torch.float64)
    seen = torch.ones(rows, 1, dtype=torch.bool)
    return RunGrid("run", 0.0, H, zero, zero + 1, value[:, None], seen)


def test_a_cubic_is_read_exactly_everywhere() -> None:
    t = torch.arange(101, dtype=torch.float64) * H
    y = 1.0 - 2.0 * t + 3.0 * t**2 - 4.0 * t**3
    at = torch.tensor([0.0, 0.003, 0.5, 0.777, 1.0], dtype=torch.float64)  # ends and instants between rows too
    state, sd, rest, _ = local_cubic(y, torch.ones(101, dtype=torch.bool), at, 8, H)
    assert torch.allclose(state[:, 0], 1.0 - 2.0 * at + 3.0 * at**2 - 4.0 * at**3, rtol=0, atol=1e-9)
    assert torch.allclose(state[:, 1], -2.0 + 6.0 * at - 12.0 * at**2, rtol=0, atol=1e-6)
    assert torch.isfinite(sd).all()
    assert float(rest.max()) < 1e-15


def test_it_is_the_least_squares_cubic_of_the_rows_that_were_measured() -> None:
    t = torch.arange(81, dtype=torch.float64) * H
    y, seen = torch.sin(9 * t) + 1e-3 * torch.randn(81, dtype=torch.float64), torch.rand(81) > 0.2
    at, m = torch.tensor([0.3, 0.3137, 0.4049], dtype=torch.float64), 12
    state, sd, rest, dof = local_cubic(y, seen, at, m, H)
    for k, instant in enumerate(at.tolist()):
        rows = [g for g in range(round(instant / H) - m, round(instant / H) + m + 1) if seen[g]]
        X = (t[rows] - instant)[:, None] ** torch.arange(4)
        own = torch.linalg.lstsq(X, y[rows], driver="gelsd").solution
        assert torch.allclose(state[k], own[:2], rtol=0, atol=1e-8)
        assert torch.allclose(sd[k], torch.linalg.inv(X.T @ X).diagonal()[:2].sqrt(), rtol=1e-6)
        assert float(rest[k]) == pytest.approx(float((y[rows] - X @ own).square().sum()), rel=1e-6)
        assert int(dof[k]) == len(rows) - 4


@pytest.mark.slow
def test_the_sd_is_what_noise_gives() -> None:
    # 4000 draws: the sd of an estimate is known to 1.1 %, 5 % is more than 4 sigma.
    noise = torch.randn(4000, 41, dtype=torch.float64)
    at = torch.tensor([0.2], dtype=torch.float64)
    rows = [local_cubic(y, torch.ones(41, dtype=torch.bool), at, 12, H)[0][0] for y in noise]
    _, sd, _, _ = local_cubic(noise[0], torch.ones(41, dtype=torch.bool), at, 12, H)
    assert torch.allclose(torch.stack(rows).std(0), sd[0], rtol=0.05)


def test_rows_that_were_not_measured_do_not_count() -> None:
    t = torch.arange(61, dtype=torch.float64) * H
    y, seen = torch.sin(t), torch.arange(61) % 3 != 1
    broken = torch.where(seen, y, torch.full_like(y, 99.0))
    at = torch.tensor([0.3], dtype=torch.float64)
    state, _, _, _ = local_cubic(broken, seen, at, 10, H)
    assert torch.allclose(state[0], torch.tensor([0.3, 0.3], dtype=torch.float64).sin().where(
        torch.tensor([True, False]), torch.tensor([0.3, 0.3], dtype=torch.float64).cos()), atol=1e-4)  # fmt: skip


def test_too_few_rows_are_said_to_know_nothing() -> None:
    seen = torch.zeros(61, dtype=torch.bool)
    seen[:4] = True
    _, sd, _, _ = local_cubic(torch.zeros(61, dtype=torch.float64), seen, torch.tensor([0.3]).double(), 5, H)
    assert torch.isinf(sd).all()


def test_slow_motion_is_smoothed_longer_than_fast() -> None:
    t = torch.arange(1000, dtype=torch.float64) * H
    noise = 1e-3 * torch.randn(1000, dtype=torch.float64)
    slow, fast = (half_window([grid(torch.sin(w * t) + noise)], 0) for w in (1.0, 12.0))
    assert slow > fast >= 3


@pytest.mark.parametrize("rows", [2, 5, 9])
def test_runs_shorter_than_any_half_window_do_no_harm(rows: int) -> None:
    y = torch.linspace(0, 1, rows, dtype=torch.float64)
    assert half_window([grid(y)], 0) >= 3


def test_the_half_window_of_a_slow_signal_holds_more_rows_than_a_cubic_goes_through() -> None:
    t = torch.arange(2001, dtype=torch.float64) * H
    fast = grid(torch.sin(6 * t) + 1e-3 * torch.randn(2001, dtype=torch.float64))
    slow = replace(fast, observed=(torch.arange(2001) % 3 == 0)[:, None])
    m = half_window([slow], 0)
    _, sd, _, dof = local_cubic(slow.value[:, 0], slow.observed[:, 0], t[200:-200:7], m, H)
    assert float(dof.min()) > 0
    assert bool(torch.isfinite(sd).all())


def test_a_hole_does_not_make_the_half_window_longer() -> None:
    """It would have to reach over the hole for most places to hold rows, and be far too long for the motion."""
    t = torch.arange(1200, dtype=torch.float64) * H
    whole = grid(torch.sin(9 * t) + 1e-3 * torch.randn(1200, dtype=torch.float64))
    seen = whole.observed.clone()
    seen[300:750] = False
    assert half_window([replace(whole, observed=seen)], 0) <= 1.5 * half_window([whole], 0)
