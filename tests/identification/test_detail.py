"""The error in detail: profiles find where an error was put, windows and horizons average back to the whole."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch

from onlinebayes.criticism.findings.profiles import profiles
from onlinebayes.criticism.timing import Stopwatch
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.heldout import horizon_errors, window_errors
from onlinebayes.identification.results import ReplayedRun

SIGNALS = ("qpos.a",)


def run(error: torch.Tensor, name: str = "one", window_rows: int = 100) -> ReplayedRun:
    """A joint that swings with 0.5 Hz and a model that is off by ``error`` (T,), 100 rows a second."""
    rows = torch.arange(len(error), dtype=torch.float64)
    time = rows / 100
    measured = torch.cos(math.pi * time)[:, None]
    window = (rows // window_rows).int()
    return ReplayedRun(name, True, time, measured.sign(), measured, measured + error[:, None], measured, window)


def found(before: ReplayedRun, after: ReplayedRun, quantity: str) -> object:
    shares = profiles((before,), (after,), SIGNALS, ("m",), {"qpos.a": "rad"})
    return next(profile for profile in shares if profile.quantity == quantity)


def test_an_error_in_one_direction_is_found_there() -> None:
    time = torch.arange(400, dtype=torch.float64) / 100
    forward = torch.sin(math.pi * time) < 0
    wrong = run(torch.where(forward, 0.1, 0.0).double())
    profile = found(wrong, run(0.5 * (wrong.simulated - wrong.measured)[:, 0]), "direction")
    assert profile.labels == ("backward", "at rest", "forward")
    assert profile.before[2] > 0.95
    assert profile.time[2] == pytest.approx(0.5, abs=0.03)
    assert profile.after == pytest.approx([share / 4 for share in profile.before])


def test_an_even_error_concentrates_nowhere() -> None:
    even = run(torch.full((400,), 0.1).double())
    for profile in profiles((even,), (even,), SIGNALS, ("m",), {"qpos.a": "rad"}):
        assert profile.concentration == pytest.approx(0.0, abs=1e-12)
        assert sum(profile.time) == pytest.approx(1.0)


def test_an_error_after_each_reversal_is_found_by_the_time_since() -> None:
    since = (torch.arange(400) % 100).double() / 100  # cos(pi t) turns round every second
    profile = found(run(torch.where(since < 0.2, 0.1, 0.0).double()), run(torch.zeros(400).double()), "reversal")
    assert sum(profile.before[:3]) > 0.9
    assert profile.after == pytest.approx([0.0] * 12)


def test_rows_without_a_measurement_and_diverged_ones_count_nowhere() -> None:
    before = run(torch.full((400,), 0.1).double())
    lost = before.measured.clone()
    lost[:100] = torch.nan
    simulated = before.simulated.clone()
    simulated[100:200] = torch.nan
    before = dataclasses.replace(before, measured=lost, simulated=simulated)
    profile = found(before, before, "time")
    assert sum(profile.time[:6]) == pytest.approx(0.0, abs=0.01)
    assert sum(profile.before) == pytest.approx(1.0)


def test_a_signal_at_a_tenth_of_the_rate_still_has_velocities() -> None:
    full = run(torch.full((400,), 0.1).double())
    sparse = torch.where((torch.arange(400) % 10 == 0)[:, None], full.measured, torch.nan)
    profile = found(dataclasses.replace(full, measured=sparse), dataclasses.replace(full, measured=sparse), "velocity")
    assert profile.edges[-1] == pytest.approx(math.pi, rel=0.1)
    assert sum(profile.time) == pytest.approx(1.0)


def test_of_several_commands_the_telling_one_is_kept() -> None:
    time = torch.arange(400, dtype=torch.float64) / 100
    full = run(torch.where(time < 1, 0.1, 0.0).double())
    two = torch.stack([torch.sin(9 * time), (time < 1).double()], 1)
    full = dataclasses.replace(full, command=two)
    shares = profiles((full,), (full,), SIGNALS, ("idle", "telling"), {"qpos.a": "rad"})
    assert [profile.name for profile in shares if profile.quantity == "command"] == ["ctrl.telling"]


def test_windows_average_back_to_the_whole() -> None:
    torch.manual_seed(0)
    before = run(torch.randn(400).double())
    windows = window_errors((before,), (run(torch.zeros(400).double()),), SIGNALS)
    assert len(windows) == 4
    whole = float((before.simulated - before.measured).square().mean())
    assert sum(window.before**2 for window in windows) / 4 == pytest.approx(whole)
    assert [window.start for window in windows] == [0.0, 1.0, 2.0, 3.0]
    assert all(window.after == 0 for window in windows)


def test_a_horizon_that_grows_is_seen_to_grow() -> None:
    since = (torch.arange(400) % 100).double() / 100
    before, after = run(since), run(0.1 * since)
    windows = _windows()
    (error,) = horizon_errors((before,), (after,), windows, SIGNALS, bins=10)
    assert error.time[0] == pytest.approx(0.05)
    assert error.before == pytest.approx([t - 0.005 for t in error.time], abs=1e-2)
    assert error.after == pytest.approx([value / 10 for value in error.before])
    assert error.floor == pytest.approx([0.01] * 10)


def test_the_stopwatch_keeps_every_line() -> None:
    said: list[str] = []
    watch = Stopwatch(said.append)
    watch("one")
    watch("two")
    assert said == ["one", "two"] == [timing.stage for timing in watch.timings()]
    assert all(timing.seconds >= 0 for timing in watch.timings())


def _windows() -> Windows:
    """Four windows of a second with a noise floor of 0.01."""
    W, K, zero = 4, 100, torch.zeros(4, 2, dtype=torch.float64)
    rows = torch.zeros(W, K, 1, dtype=torch.float64)
    seen = torch.ones(W, K, 1, dtype=torch.bool)
    return Windows(
        step=0.01, bin_rows=1, run=torch.zeros(W, dtype=torch.int64), first=torch.arange(W) * K, command=rows,
        enable=rows, history=rows[:, :0], history_enable=rows[:, :0], value=rows, observed=seen, measured=seen,
        inside=seen[..., 0], start=zero, start_sd=zero, start_prior=zero,
        start_given=zero > 0, free=torch.ones(W, 1, dtype=torch.bool),
        noise=torch.tensor([0.01], dtype=torch.float64), columns=(0,), runs=("one",), begin=(0.0,),
    )  # fmt: skip
