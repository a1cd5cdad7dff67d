"""Regions where the error concentrates: those that hold most of it for their size.

Regions are of speed, position, command, time since a run's start, and runs (of a single one the thirds of its time).
Error is the start-projected residual over short windows, so that a row's error comes from its own neighbourhood;
regions are compared by share of squared error over share of time, those that hold a fifth of the error at least.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.criticism.results import Failure
from onlinebayes.identification import quantities
from onlinebayes.identification.data.motion import seen_by
from onlinebayes.identification.data.windows import Windows, joint_names
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.projection import project

SHORT_WINDOWS = 3
"""Each window is cut into so many."""

LEAST_SHARE = 0.2
LEAST_LIFT = 1.25


@dataclass(frozen=True)
class Region:
    """A part of the data in words, and which bins of the long windows belong to it."""

    where: str
    bins: Bool[Tensor, "W n"]


def failures(fitted: Fit, windows: Windows, units: dict[str, str], most: int = 3) -> tuple[Failure, ...]:
    """The regions in which each signal's error concentrates, worst first; at most ``most`` a signal."""
    short = project(windows, fitted.lin, pieces=SHORT_WINDOWS)
    square = short.measured_rows(short.residual).square()
    n = square.shape[1]
    found: list[Failure] = []
    signals = [fitted.simulator.signals[c] for c in windows.columns]
    regions = _regions(fitted, windows, units)
    for s, signal in enumerate(signals):
        seen = short.seen()[..., s]
        error, total, time = square[..., s] * seen, float((square[..., s] * seen).sum()), float(seen.sum())
        if total == 0:
            continue
        mine = []
        for region in regions:
            mask = region.bins[:, : n * SHORT_WINDOWS].unflatten(1, (SHORT_WINDOWS, n)).flatten(0, 1) & seen
            share, part = float(error[mask].sum()) / total, float(mask.sum()) / time
            if part > 0 and share >= LEAST_SHARE and share >= LEAST_LIFT * part:
                mine.append(Failure(signal, region.where, share, part))
        mine.sort(key=lambda f: -f.share_of_error * f.share_of_error / f.share_of_time)
        found += mine[:most]
    return tuple(found)


def _regions(fitted: Fit, windows: Windows, units: dict[str, str]) -> list[Region]:
    simulator, seen = fitted.simulator, windows.seen.any(-1)
    signals = [simulator.signals[c] for c in windows.columns]
    motion, command = windows.bin(windows.value), _binned_command(windows)
    found: list[Region] = []
    for joint in joint_names(simulator):
        by = seen_by(joint, signals)
        v = by.velocity(motion, windows.bin_step)
        speed, unit = v.abs(), by.speed_unit(units)
        for level, word in ((0.25, "<"), (0.75, ">")):
            edge = float(speed[seen].quantile(level)) if bool(seen.any()) else 0.0
            found.append(Region(f"|qvel.{joint}| {word} {edge:.2g} {unit}", _beyond(speed, edge, word)))
        found.append(Region(f"qvel.{joint} > 0", v > 0))
        found.append(Region(f"qvel.{joint} < 0", v < 0))
        if not by.position:
            continue
        q, unit = motion[..., by.column], units.get(by.signal) or ""
        for level, word in ((0.25, "<"), (0.75, ">")):
            edge = float(q[seen].quantile(level)) if bool(seen.any()) else 0.0
            found.append(Region(f"qpos.{joint} {word} {edge:.2g} {unit}", _beyond(q, edge, word)))
    for u, name in enumerate(simulator.commands):
        size = command[..., u].abs()
        edge = float(size[seen].quantile(0.75)) if bool(seen.any()) else 0.0
        found.append(Region(f"|ctrl.{name}| > {edge:.2g}", size > edge))
    return found + _places(windows)


def _places(windows: Windows) -> list[Region]:
    """The beginnings and the ends of runs, the runs, and the thirds of the only one's time."""
    shape = (windows.count, windows.bins)
    found = _since_the_start(windows)
    for r, name in enumerate(windows.runs):
        mine = windows.run == r
        if len(windows.runs) > 1:
            found.append(Region(f"run '{name}'", mine[:, None].expand(shape)))
        elif windows.count >= 6:
            order = torch.arange(windows.count, device=mine.device)
            for third, word in enumerate(("first", "middle", "last")):
                part = (order * 3 // windows.count) == third
                found.append(Region(f"the {word} third of the time", part[:, None].expand(shape)))
    return found


def _since_the_start(windows: Windows) -> list[Region]:
    """Return the regions early and late in a run: a motor that sticks at first, or one that warms up."""
    middle = windows.bin_rows * (torch.arange(windows.bins, device=windows.first.device) + 0.5)
    since, seen = (windows.first[:, None] + middle) * windows.step, windows.seen.any(-1)
    found = []
    for level, word in ((0.25, "<"), (0.75, ">")):
        edge = float(since[seen].quantile(level)) if bool(seen.any()) else 0.0
        where = f"time since the run's start {word} {quantities.significant(edge)} s"
        found.append(Region(where, _beyond(since, edge, word)))
    return found


def _beyond(values: Float[Tensor, "W n"], edge: float, word: str) -> Bool[Tensor, "W n"]:
    return values < edge if word == "<" else values > edge


def _binned_command(windows: Windows) -> Float[Tensor, "W n U"]:
    return windows.command.unflatten(1, (windows.bins, windows.bin_rows)).mean(2)
