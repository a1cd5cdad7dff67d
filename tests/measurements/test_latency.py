"""A late column moved back, where its cells stand in rows of their own."""

from __future__ import annotations

import numpy as np
import pytest

from onlinebayes.measurements.latency import advanced


def _apart(gap: float, period: float = 0.01, count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    """Rows of commands, and of measurements ``gap`` seconds after each: time [s], and which rows are measured."""
    sent = period * np.arange(count)
    time = np.sort(np.concatenate([sent, sent + gap]))
    return time, np.arange(2 * count) % 2 == 1


@pytest.mark.parametrize("latency", [0.005, 0.0012, 0.03, 0.0341, -0.004])
@pytest.mark.parametrize("gap", [0.003, 0.005, 1e-6])
def test_commands_and_measurements_on_clocks_of_their_own(gap, latency):
    """Each reading but those at the run's ends goes to one row, and to one only."""
    time, measured = _apart(gap)
    late = np.where(measured, np.sin(3 * (time - latency)), np.nan)
    found = advanced(time, late, latency)
    lost = measured.sum() - (~np.isnan(found)).sum()
    assert 0 <= lost <= np.ceil(abs(latency) / 0.01)
    assert np.nanmax(np.abs(found - np.sin(3 * time))) < 5e-4


def test_a_reading_is_moved_and_not_averaged():
    """Noise of the sensor stays what it is: no row is made of two cells, no cell makes two rows."""
    time, measured = _apart(0.003)
    noise = np.random.default_rng(0).standard_normal(len(time))
    found = advanced(time, np.where(measured, noise, np.nan), 0.003)
    kept = found[~np.isnan(found)]
    np.testing.assert_allclose(kept, noise[measured][-len(kept) :], atol=1e-9)


def test_rare_jitter_loses_a_reading_rather_than_moving_all():
    """With a latency of three tenths of a row and one late stamp, the others stay in their nearest rows."""
    time = 0.1 * np.arange(200.0)
    time[90] += 0.03
    found = advanced(time, np.sin(time - 0.03), 0.03)
    known = ~np.isnan(found)
    assert (~known).sum() <= 2
    np.testing.assert_allclose(found[known], np.sin(time[known]), atol=2e-3)
