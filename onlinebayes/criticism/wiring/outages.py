"""Actuators that were off for a part of a run, whatever the table commands.

    e_w(i, j)   RMS of window w's replay with the actuators off from row i to row j           [floors]
    struck:     windows with e_w(none) > 3 times the median, and min over (i, j) e_w(i, j) < e_w(none) / 2

An outage of a second spoils the windows that it touches and no others, but also the fit of all: parameters are fitted
to the better half of the windows first, three times (concentration steps, Rousseeuw and Van Driessen 1999). Edges are
looked for on eighths of a window, then on sixty-fourths, and where a run's parts begin and end is settled beside theta
(:mod:`.outage_edges`). Which actuators: each alone, or all together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.wiring.faults import Fault
from onlinebayes.criticism.wiring.outage_edges import Stretch, settled
from onlinebayes.criticism.wiring.replay_rms import replay_rms
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

STRUCK_MEDIANS = 3.0
"""A window that errs by more than so many times the median error may be struck."""

MOST_PARTS = 3
"""Most stretches of an outage, or the number of runs if larger: more would be a law; the longest ones count."""

STRUCK_SHARE = 0.5
"""A window is struck where being off leaves less than this share of its error."""

EIGHTHS = 8
"""Edges are looked for on so many parts of a window first."""

FINER = 8
"""Edges are then looked for on so many parts of each of these."""

MOST_STRUCK = 24
"""So many windows are looked at, the worst ones."""

DIVERGED = 1e6
"""The error of a window in which the model diverges [floors]."""

CONCENTRATIONS = 3
"""Parameters are fitted to the better half of the windows so often."""

Spans = tuple[tuple[str, float, float], ...]


@dataclass(frozen=True)
class Outage(Fault):
    """Actuators that gave no force for parts of runs: ``spans`` of (run, from, to) [s]."""

    actuators: tuple[str, ...]
    spans: Spans

    @property
    def says(self) -> str:
        """``motor was off from 2.4 s to 3.6 s in run3``; the first three parts, and how many more."""
        verb = "was" if len(self.actuators) == 1 else "were"
        shown = [f"from {begin:.3g} s to {end:.3g} s in {run}" for run, begin, end in self.spans[:3]]
        more = [f"in {len(self.spans) - 3} more parts"] if len(self.spans) > 3 else []
        return f"{' and '.join(self.actuators)} {verb} off {', '.join((*shown, *more))}, whatever the table commands"

    @property
    def lines(self) -> str:
        """The columns that the table lacks."""
        columns = " and ".join(f"enable.{actuator}" for actuator in self.actuators)
        parts = "".join(f"\n#   {run}: {begin:.4g} to {end:.4g} s" for run, begin, end in self.spans)
        return f"# in the table: {columns}, 1 in every row, but 0 in{parts}"

    def correct(self, measurement: Measurement) -> Measurement:
        """The actuators disabled in these spans."""
        data = measurement.data.clone(recurse=False)
        data["enable"] = data["enable"].clone()
        columns = [measurement.commands.index(name) for name in self.actuators]
        for run, begin, end in self.spans:
            if run in measurement.runs:
                r = measurement.runs.index(run)
                time = data["time"][r]
                rows = torch.nonzero((time >= begin) & (time < end))[:, 0]
                data["enable"][r, rows[:, None], columns] = 0.0
        return replace(measurement, data=data)


@dataclass(frozen=True)
class Sighting:
    """Windows that speak for an outage.

    Args:
        columns: the actuators' places among the commands.
        stretches: where they seem to have been off.
        left: share of the squared error of the windows that stand out that is left then.
        theta: fitted to the better half of the windows [SI].
        coarse, windows: what was looked at.
    """

    columns: tuple[int, ...]
    stretches: tuple[Stretch, ...]
    left: float
    theta: Float[Tensor, " P"]
    coarse: Identifiable
    windows: Windows

    @property
    def settled(self) -> Outage | None:
        """The outage with its edges in place; None where being off explains none of them in the end."""
        found = settled(self.stretches, self.columns, self.coarse, self.windows, self.theta)
        most = max(MOST_PARTS, len(self.windows.runs))
        longest = sorted(_spans(found, self.windows), key=lambda span: span[1] - span[2])[:most]
        names = tuple(self.coarse.commands[u] for u in self.columns)
        return Outage(names, tuple(sorted(longest))) if longest else None


def sighted(fitted: Float[Tensor, " P"], coarse: Identifiable, windows: Windows) -> Sighting | None:
    """The outage that the windows speak for; None where no few of them stand out, or being off explains none.

    Args:
        fitted: theta of the base model [SI].
        coarse: that model in the steps in which it is replayed.
        windows: of the fit runs.
    """
    starts, windows = _starts(fitted, coarse), _moving(windows)
    if not any(_some_stand_out(_errors(coarse, windows, theta)) for theta in starts):
        return None  # before anything is fitted
    theta = _robust(starts, coarse, windows)
    own = _errors(coarse, windows, theta).clamp(max=DIVERGED)
    if not _some_stand_out(own):
        return None
    apart = torch.nonzero(own > STRUCK_MEDIANS * own.median())[:, 0]
    suspects = apart[own[apart].argsort(descending=True)[:MOST_STRUCK]].sort().values
    part, before = windows.select(suspects), own[suspects]
    found = []
    for columns in _sets(len(coarse.commands)):
        edges, after = _best_edges(coarse, part, theta, columns)
        struck = after < STRUCK_SHARE * before
        if bool(struck.any()):
            left = float(torch.where(struck, after, before).square().sum() / before.square().sum())
            found.append((left, columns, edges, struck))
    if not found:
        return None
    left, columns, edges, struck = min(found, key=lambda one: one[0])
    places = [(run, at + a, at + b) for (run, at), (a, b) in zip(_places(part), edges.tolist(), strict=True)]
    seen = _joined([place for place, hit in zip(places, struck.tolist(), strict=True) if hit], part)
    return Sighting(tuple(columns), tuple(seen), left, theta, coarse, windows)


def _moving(windows: Windows) -> Windows:
    """Those in which something is scored: where all joints rest no model errs, and of many such the median is zero."""
    return windows.select(torch.nonzero(windows.moving)[:, 0])


def _starts(fitted: Float[Tensor, " P"], coarse: Simulator) -> tuple[Float[Tensor, " P"], ...]:
    """The fitted theta and the nominal one."""
    return fitted, coarse.parameters.clamp(coarse.nominal.to(fitted))


def _some_stand_out(errors: Float[Tensor, " W"]) -> bool:
    """Check whether a few windows err by far more than the others; more than half of them cannot (see the median)."""
    return bool((errors > STRUCK_MEDIANS * errors.median()).any())


def _robust(starts: Sequence[Float[Tensor, " P"]], coarse: Identifiable, windows: Windows) -> Float[Tensor, " P"]:
    """Theta of the half of the windows that fit best, from the best of these starts."""
    half = (windows.count + 1) // 2
    found = []
    for theta in starts:
        misfit = _misfit(coarse, windows, theta)
        for _ in range(CONCENTRATIONS):
            better = misfit.argsort()[:half].sort().values
            theta = fit(coarse, windows.select(better), theta).theta
            misfit = _misfit(coarse, windows, theta)
        found.append((float(misfit.sort().values[:half].sum()), theta))
    return min(found, key=lambda one: one[0])[1]


def _misfit(coarse: Identifiable, windows: Windows, theta: Float[Tensor, " P"]) -> Float[Tensor, " W"]:
    """Squared residual of each window with its start projected out; infinite where the model diverges."""
    whole = torch.nonzero(_errors(coarse, windows, theta).isfinite())[:, 0]
    rows = fit(coarse, windows.select(whole), theta, most=0).rows
    left = rows.in_noise(rows.residual).square().sum((1, 2))
    return left.new_full((windows.count,), math.inf).index_copy(0, whole, left)


def _errors(simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"]) -> Float[Tensor, " W"]:
    return replay_rms(simulator, windows, theta[None], windows.noise)[0]


def _sets(actuators: int) -> Iterator[tuple[int, ...]]:
    """Each actuator alone, and all of them."""
    yield from ((u,) for u in range(actuators))
    if actuators > 1:
        yield tuple(range(actuators))


def _best_edges(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"], columns: Sequence[int]
) -> tuple[Int[Tensor, "W 2"], Float[Tensor, " W"]]:
    """The rows from and to which being off explains each window best, and what error that leaves [floors]."""
    K = windows.rows
    coarse = torch.linspace(0, K, EIGHTHS + 1, device=theta.device).round().long()
    tried = coarse.new_tensor([(i, j) for i in coarse.tolist() for j in coarse.tolist() if i < j])
    edges, errors = _tried(simulator, windows, theta, columns, tried.expand(windows.count, -1, 2))
    fine = torch.linspace(-K / EIGHTHS, K / EIGHTHS, 2 * FINER + 1, device=theta.device).round().long()
    for side in (0, 1, 0):
        moved = edges[:, None].repeat(1, len(fine), 1)
        # An outage that reaches a window's edge goes on in the next one.
        inside = (moved[..., side] > 0) & (moved[..., side] < K)
        moved[..., side] = torch.where(inside, moved[..., side] + fine, moved[..., side]).clamp(0, K)
        again, better = _tried(simulator, windows, theta, columns, moved)
        edges = torch.where((better < errors)[:, None], again, edges)
        errors = torch.minimum(better, errors)
    return edges, errors


def _tried(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    columns: Sequence[int],
    edges: Int[Tensor, "W C 2"],
) -> tuple[Int[Tensor, "W 2"], Float[Tensor, " W"]]:
    """The best of C pairs of edges for each window, and its error."""
    W, C = edges.shape[:2]
    window = torch.arange(W, device=edges.device)
    many = windows.select(window.repeat_interleave(C))
    first, last = edges.flatten(0, 1).unbind(1)
    row = torch.arange(windows.rows, device=edges.device)
    off = (row >= first[:, None]) & (row < last[:, None])
    enable = many.enable.clone()
    enable[..., list(columns)] *= 1.0 - off[..., None].to(enable)
    errors, best = _errors(simulator, replace(many, enable=enable), theta).unflatten(0, (W, C)).min(1)
    return edges[window, best], errors


def _places(windows: Windows) -> list[tuple[int, int]]:
    """Run and first row of each window."""
    return list(zip(windows.run.tolist(), windows.first.tolist(), strict=True))


def _joined(stretches: Sequence[Stretch], windows: Windows) -> list[Stretch]:
    """Stretches with an eighth of a window or less between them as one."""
    joined: list[Stretch] = []
    between = math.ceil(windows.rows / EIGHTHS)
    for run, begin, end in sorted(stretches):
        if joined and joined[-1][0] == run and begin <= joined[-1][2] + between:
            joined[-1] = (run, joined[-1][1], max(joined[-1][2], end))
        else:
            joined.append((run, begin, end))
    return joined


def _spans(stretches: Sequence[Stretch], windows: Windows) -> Spans:
    """(run, from, to) [s]."""
    return tuple(
        (windows.runs[run], windows.begin[run] + windows.step * a, windows.begin[run] + windows.step * b)
        for run, a, b in _joined(stretches, windows)
    )
