import math
from dataclasses import replace

import pytest
import torch

from onlinebayes.identification.data.grid import RunGrid
from onlinebayes.identification.data.noise import correlation_time, noise_floors, sensor_sd
from onlinebayes.measurements import Signal


def grid(value: torch.Tensor) -> RunGrid:
    zero = torch.zeros(len(value), 1, dtype=torch.float64)
    return RunGrid("run", 0.0, 0.01, zero, zero, value[:, None], torch.ones(len(value), 1, dtype=torch.bool))


def test_the_sensor_sd_is_found_under_motion() -> None:
    # 5000 rows: the estimate is known to about 1.7 % (fourth differences are correlated); 7 % is 4 sigma.
    t = torch.arange(5000, dtype=torch.float64) * 0.01
    y = torch.sin(3 * t) + 2e-3 * torch.randn(5000, dtype=torch.float64)
    assert sensor_sd([grid(y)], 0) == pytest.approx(2e-3, rel=0.07)


def test_jumps_are_clipped() -> None:
    y = 1e-3 * torch.randn(5000, dtype=torch.float64)
    y[2500:] += 5.0
    assert sensor_sd([grid(y)], 0) == pytest.approx(1e-3, rel=0.07)


def test_a_signal_slower_than_the_clock_has_its_own_neighbours() -> None:
    t = torch.arange(5000, dtype=torch.float64) * 0.01
    y = torch.sin(0.3 * t) + 2e-3 * torch.randn(5000, dtype=torch.float64)
    slow = grid(y)
    for seen in (torch.arange(5000) % 2 == 0, torch.arange(5000) % 5 < 2):  # every other row; two rows, three without
        # 2000 rows: the estimate is known to about 2.6 %; 11 % is 4 sigma.
        assert sensor_sd([replace(slow, observed=seen[:, None])], 0) == pytest.approx(2e-3, rel=0.11)


def test_the_floor_is_the_largest_of_what_is_known() -> None:
    y = grid(1e-3 * torch.randn(2000, dtype=torch.float64))
    given = noise_floors([Signal("q", sd=5e-3)], [y])
    coarse = noise_floors([Signal("q", sd=1e-4, resolution=0.1)], [y])
    nothing = noise_floors([Signal("q")], [grid(torch.zeros(100, dtype=torch.float64))])
    assert float(given) == 5e-3
    assert float(coarse) == pytest.approx(0.1 / math.sqrt(12))
    assert float(nothing) > 0


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.8])
def test_tau_of_an_autoregression(phi: float) -> None:
    # Exactly Delta (1 + phi) / (1 - phi); the cut at rho <= .02 leaves a little out, sampling adds 10 %.
    noise = torch.randn(200, 500, dtype=torch.float64)
    r = torch.zeros_like(noise)
    for k in range(1, 500):
        r[:, k] = phi * r[:, k - 1] + noise[:, k]
    found = correlation_time(r[:, 100:, None], torch.ones(200, 400, 1, dtype=torch.bool), 0.01)
    assert found == pytest.approx(0.01 * (1 + phi) / (1 - phi), rel=0.12)


@pytest.mark.parametrize("every", [1, 2, 3])
def test_tau_of_a_sensor_slower_than_the_bins(every: int) -> None:
    """Slow noise: Delta (1 + phi) / (1 - phi), whichever lags the sensor has; none of them has a neighbour."""
    phi, noise = 0.9, torch.randn(200, 500, dtype=torch.float64)
    r = torch.zeros_like(noise)
    for k in range(1, 500):
        r[:, k] = phi * r[:, k - 1] + noise[:, k]
    seen = (torch.arange(400) % every == 0).expand(200, 400)[..., None]
    found = correlation_time(r[:, 100:, None], seen, 0.01)
    assert found == pytest.approx(0.01 * (1 + phi) / (1 - phi), rel=0.2)
