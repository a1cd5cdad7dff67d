"""The limit of a window's length: the time in which an error of its start grows e-fold in open loop.

    H = the first t at which  median over windows of  max over joints j, t' <= t of  |d q_j(t') / d q_j(0)|  >  e

A machine that its controller holds upright, replayed from its logged commands, falls: over many e-foldings the replay
says nothing about the model, and its starts cannot be fitted. Machines that swing, slide or fly keep the derivative of
a position by itself near or below one and keep their windows; a few windows about an unstable point do not decide.
A joint whose velocity alone is measured moves alike wherever it is (see :mod:`.data.motion`), and does not fall.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import MEMORY, Windows, joint_names, make_windows
from onlinebayes.identification.fitting.sensitivities import linearise_starts
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable

SAMPLE = 24  # windows that are looked at, spread over the runs
FEWEST_ROWS = 10


def within_runs(selection: Selection, measurement: Measurement) -> Selection:
    """The selection with a horizon that was asked for no longer than the longest run.

    No window is longer, and the commands that are kept before one take memory in proportion to what was asked for.

    Args:
        selection: how effects are judged.
        measurement: the fit runs.
    """
    longest = float(f"{max(measurement.durations):.6g}")
    if not selection.fixed_horizon or selection.horizon_s <= longest:
        return selection
    return replace(selection, horizon_s=longest)


def cut_to_runs(asked: Selection, used: Selection) -> tuple[str, ...]:
    """Return a note for a user whose windows :func:`within_runs` cut; nothing where it did not."""
    if used.horizon_s == asked.horizon_s:
        return ()
    return (f"windows last {used.horizon_s:g} s in place of {asked.horizon_s:g} s: no run is longer",)


def steady(simulator: Identifiable, measurement: Measurement, selection: Selection) -> Selection:
    """The selection with windows short enough for a machine that is unstable in open loop.

    Args:
        simulator: the base model; taken at its nominal parameters.
        measurement: the fit runs.
        selection: how effects are judged; its horizon is only ever shortened, and only where it says so.
    """
    if selection.fixed_horizon:
        return selection
    windows = make_windows(simulator, measurement, selection.horizon_s, MEMORY * selection.horizon_s)
    sample = torch.linspace(0, windows.count - 1, min(windows.count, SAMPLE), device=windows.start.device)
    windows = windows.select(sample.round().long())
    typical = growth(simulator, windows).median(0).values
    beyond = (typical > math.e).nonzero()
    if not len(beyond):
        return selection
    rows = max(FEWEST_ROWS, int(beyond[0]) * windows.bin_rows)
    return replace(selection, horizon_s=round(rows * windows.step, 6))


def shortened(asked: Selection, used: Selection) -> tuple[str, ...]:
    """Return a note for a user whose windows are shorter than asked for; nothing where they are not."""
    if used.horizon_s == asked.horizon_s:
        return ()
    return (
        f"windows last {used.horizon_s:g} s, not {asked.horizon_s:g} s: replayed from its commands alone the model is "
        "unstable, and after that time an error of its start has grown e-fold; selection.horizon_s sets another length",
    )


def growth(simulator: Identifiable, windows: Windows) -> Float[Tensor, "W n"]:
    """By how much an error of a start has grown at most until each bin, of the joint where it grows most [1]."""
    theta = simulator.parameters.clamp(simulator.nominal.to(windows.start))
    by_start = linearise_starts(simulator, windows, theta, windows.start).by_start.abs()
    shown = [simulator.signals[column] for column in windows.columns]
    itself = by_start.new_zeros(by_start.shape[:2])
    for j, joint in enumerate(joint_names(simulator)):
        if f"qpos.{joint}" in shown:
            moved = by_start[:, :, shown.index(f"qpos.{joint}"), j] * windows.free[:, j : j + 1]
            itself = torch.maximum(itself, torch.nan_to_num(moved, nan=math.inf))
    return itself.cummax(1).values
