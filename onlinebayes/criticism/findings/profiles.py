"""The spread of the squared error over time, position, velocity, direction, time since a reversal, command and run.

    share of error in bin b = sum over its rows of (measured - simulated)^2 / sum over all rows,
    share of time in bin b  = its rows / all rows

A bin whose share of error stands well above its share of time is where the model fails. Velocities are central
differences of the measured positions over 50 ms, or as measured where no position was. Of several commands the one that
parts error from time most is kept; of the joints a signal's own, or for a signal of no joint likewise the most telling
one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from onlinebayes.identification.data.motion import SeenBy, seen_by
from onlinebayes.identification.detail import Profile, Quantity
from onlinebayes.identification.results import ReplayedRun

Array = NDArray[np.float64]
BINS = 12
DIFFERENCE = 0.05  # span of the differences that give velocities [s]
AT_REST = 0.02  # of the largest speed: below it a joint counts as at rest


@dataclass(frozen=True)
class _Binned:
    """A quantity and the bin of each row (T,), -1 for none."""

    quantity: Quantity
    name: str
    unit: str
    edges: tuple[float, ...]
    labels: tuple[str, ...]
    index: NDArray[np.intp]


def profiles(
    before: Sequence[ReplayedRun],
    after: Sequence[ReplayedRun],
    signals: Sequence[str],
    commands: Sequence[str],
    units: Mapping[str, str],
) -> tuple[Profile, ...]:
    """Every signal's profiles, those of one signal one after the other.

    Args:
        before, after: the same runs replayed by the base and by the final model.
        signals: names of the replays' columns.
        commands: names of the command columns.
        units: signal -> unit.
    """
    if not sum(len(run.time) for run in before):
        return ()
    measured, base, final = (
        _rows(runs, name) for runs, name in ((before, "measured"), (before, "simulated"), (after, "simulated"))
    )
    joints = dict.fromkeys(name.partition(".")[2] for name in signals if name.startswith(("qpos.", "qvel.")))
    everywhere = _everywhere(before, commands)
    by_joint = {joint: _of_joint(before, seen_by(joint, signals), units) for joint in joints}
    found: list[Profile] = []
    for s, signal in enumerate(signals):
        errors = tuple((values[:, s] - measured[:, s]) ** 2 for values in (base, final))
        own = signal.partition(".")[2]
        mine = {own: by_joint[own]} if own in by_joint else by_joint
        groups = [[_profile(signal, one, *errors) for one in binned] for binned in mine.values()]
        best = max(groups, key=lambda group: max((p.concentration for p in group if p), default=0.0), default=[])
        rest = [_profile(signal, one, *errors) for one in everywhere]
        driven = [p for p in rest if p and p.quantity == "command"]
        kept = max(driven, key=lambda p: p.concentration) if driven else None
        found += [p for p in [*best, *rest] if p and (p.quantity != "command" or p is kept)]
    return tuple(found)


def _profile(signal: str, binned: _Binned, before: Array, after: Array) -> Profile | None:
    """Shares by bin; None where the base model has no error to share out, or there is one category only."""
    n = len(binned.labels) or len(binned.edges) - 1
    seen = np.isfinite(before) & np.isfinite(after) & (binned.index >= 0)
    total = float(before[seen].sum())
    if n < 2 or total <= 0:
        return None
    place = binned.index[seen]
    shares = (
        np.bincount(place, minlength=n) / len(place),
        np.bincount(place, before[seen], n) / total,
        np.bincount(place, after[seen], n) / total,
    )
    time, first, second = (tuple(share.tolist()) for share in shares)
    return Profile(signal, binned.quantity, binned.name, binned.unit, binned.edges, binned.labels, time, first, second)


def _everywhere(runs: Sequence[ReplayedRun], commands: Sequence[str]) -> list[_Binned]:
    since = np.concatenate([run.time.cpu().numpy() - float(run.time[0]) if len(run.time) else [] for run in runs])
    found = [_even("time", "time since the run's start", "s", since)]
    driven = _rows(runs, "command")
    found += [_even("command", f"ctrl.{name}", "", driven[:, u]) for u, name in enumerate(commands)]
    number = np.concatenate([np.full(len(run.time), r) for r, run in enumerate(runs)])
    labels = tuple(f"{run.run}{' (held out)' if run.held_out else ''}" for run in runs)
    return [*found, _Binned("run", "run", "", (), labels, number.astype(np.intp))]


def _of_joint(runs: Sequence[ReplayedRun], by: SeenBy, units: Mapping[str, str]) -> list[_Binned]:
    shown, joint = _rows(runs, "measured")[:, by.column], by.joint
    velocity = shown
    if by.position:
        velocity = np.concatenate(
            [_velocity(run.time.cpu().numpy(), run.measured[:, by.column].cpu().numpy()) for run in runs]
        )
    known = np.abs(velocity[np.isfinite(velocity)])
    slow = AT_REST * float(known.max()) if len(known) else 0.0
    way = np.where(np.isfinite(velocity), np.sign(velocity) * (np.abs(velocity) > slow) + 1, -1).astype(np.intp)
    since, start = [], 0
    for run in runs:
        stop = start + len(run.time)
        since.append(_since_reversal(run.time.cpu().numpy(), way[start:stop]))
        start = stop
    labels = ("backward", "at rest", "forward")
    return [
        _even("velocity", f"qvel.{joint}", by.speed_unit(units), velocity),
        *([_even("position", by.signal, units.get(by.signal) or "", shown)] if by.position else []),
        _Binned("direction", f"direction of {joint}", "", (), labels, way),
        _even("reversal", f"time since {joint} last turned round", "s", np.concatenate(since)),
    ]


def _even(quantity: Quantity, name: str, unit: str, values: Array) -> _Binned:
    """Bins of equal width from the smallest to the largest value; no bins where all values are the same."""
    known = values[np.isfinite(values)]
    if not len(known) or float(known.max()) - float(known.min()) <= 1e-12 * float(np.abs(known).max()):
        return _Binned(quantity, name, unit, (0.0,), (), np.full(len(values), -1))
    edges = np.linspace(float(known.min()), float(known.max()), BINS + 1)
    index = np.clip(np.searchsorted(edges, np.nan_to_num(values), side="right") - 1, 0, BINS - 1)
    return _Binned(quantity, name, unit, tuple(edges.tolist()), (), np.where(np.isfinite(values), index, -1))


def _velocity(time: Array, position: Array) -> Array:
    """Central differences over about DIFFERENCE, gaps in the measurement bridged; nan at the ends and in short runs."""
    found, known = np.full(len(time), np.nan), np.isfinite(position)
    if len(time) < 3 or not known.any():
        return found
    position = np.interp(time, time[known], position[known])
    half = max(1, round(0.5 * DIFFERENCE / float(np.median(np.diff(time)))))
    if len(time) > 2 * half:
        ahead, behind = slice(2 * half, None), slice(None, -2 * half)
        found[half:-half] = (position[ahead] - position[behind]) / (time[ahead] - time[behind])
    return found


def _since_reversal(time: Array, way: NDArray[np.intp]) -> Array:
    """Time [s] since the motion last changed its direction; nan before the first change."""
    moving = np.flatnonzero((way == 0) | (way == 2))
    turned = moving[1:][np.diff(way[moving]) != 0]
    last = np.searchsorted(turned, np.arange(len(time)), side="right") - 1
    found = np.full(len(time), np.nan)
    found[last >= 0] = time[last >= 0] - time[turned[last[last >= 0]]]
    return found


def _rows(runs: Sequence[ReplayedRun], name: str) -> Array:
    """One table of all runs, one below the other."""
    return np.concatenate([getattr(run, name).cpu().numpy() for run in runs]).astype(np.float64)
