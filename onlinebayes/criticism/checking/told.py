"""What was found, as the values of an answer: changes with their intervals, and parameters run by run."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from onlinebayes.criticism.checking.asked import Applied, Asked
from onlinebayes.criticism.checking.held import Scores
from onlinebayes.criticism.checking.results import Change, Drift, DriftPoint, Since
from onlinebayes.identification.data.windows import Windows

SHOWN = 4
"""Parameters whose drift is shown where nothing changed."""


def change_of(asked: Asked, applied: Applied) -> Change:
    """One change as it is told."""
    what, found = asked.changes[applied.found.change], applied.found
    after = what.value + applied.size
    low, high = (min(max(end, what.low), what.high) for end in (after - found.half, after + found.half))
    alike = (*what.alike, *(asked.changes[j].key for j in found.alike))
    since = _since(asked, found.stretch)
    return Change(what.key, what.unit, what.value, after, found.sd, low, high, since, found.p, alike)


def drifts_of(asked: Asked, new: Scores, applied: Sequence[Applied]) -> tuple[Drift, ...]:
    """Run by run: of what changed, or of the parameters that the reference tells best.

    Args:
        asked: the question.
        new: scores of the new windows, nothing made good.
        applied: what changed.
    """
    reference = asked.reference
    fitted = len(reference.covariance)
    known = (reference.J[:fitted].rsqrt() / asked.room[1][:fitted].clamp_min(1e-300)).argsort().tolist()
    found = []
    for c in dict.fromkeys([one.found.change for one in applied] or known[:SHOWN]):
        points = [
            *_points(asked, asked.old, asked.held.windows, c, True),
            *_points(asked, new, asked.windows, c, False),
        ]
        found.append(Drift(asked.changes[c].key, asked.changes[c].unit, tuple(points)))
    return tuple(found)


def _points(asked: Asked, scores: Scores, windows: Windows, c: int, old: bool) -> list[DriftPoint]:
    """The value of one number in every run, alone, to first order."""
    found, reference, what = [], asked.reference, asked.changes[c]
    for r, name in enumerate(windows.runs):
        mine = windows.run == r
        if not bool(mine.any()) or not (J := float(scores.J[mine, c, c].sum())) > 0:
            continue
        size = float(scores.u[mine, c].sum()) / J - float(reference.mean[c])
        sd = float(reference.sd(scores.J[mine].sum(0)[None], torch.ones(1, dtype=torch.float64))[0, c])
        found.append(DriftPoint(name, old, what.value + size, sd))
    return found


def _since(asked: Asked, stretch: int) -> Since:
    """The begin of a stretch."""
    windows = asked.windows
    first = int((asked.stretch == stretch).nonzero()[0, 0])
    run = int(windows.run[first])
    begins = first == 0 or int(windows.run[first - 1]) != run
    return Since(windows.runs[run], None if begins else windows.spans[first][1], stretch == 0)
