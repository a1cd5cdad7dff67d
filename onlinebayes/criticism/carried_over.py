"""Held-out runs in which the refined model errs more than the base model: what was accepted does not hold there.

Nothing is decided by the held-out runs, which are looked at once. But a law that serves the fit runs and not a run of
another kind is one that their user should know of, and a mean over all held-out runs may hide it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from onlinebayes.criticism import quantities
from onlinebayes.criticism.detail import WindowError

MORE = 1.02  # times; windows are counted alike, whatever their rows
MOST_RUNS = 3  # that are named


def worse_runs_note(windows: Iterable[WindowError], units: dict[str, str]) -> tuple[str, ...]:
    """A sentence that names the held-out runs in which the error rises, the worst first; nothing without any.

    Args:
        windows: errors of the base and of the refined model.
        units: signal -> unit.
    """
    squares: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for one in windows:
        if one.held_out:
            squares.setdefault((one.run, one.signal), []).append((one.before**2, one.after**2))
    errors = {
        place: tuple(math.sqrt(sum(pair[k] for pair in pairs) / len(pairs)) for k in (0, 1))
        for place, pairs in squares.items()
    }
    rising = {place: pair for place, pair in errors.items() if pair[1] > MORE * pair[0]}
    if not rising:
        return ()
    order = sorted(rising, key=lambda place: -rising[place][1] / max(rising[place][0], 1e-300))
    told = [
        f"{signal} in “{run}” {quantities.text(rising[run, signal][0], units[signal])} → "
        f"{quantities.text(rising[run, signal][1], units[signal])}"
        for run, signal in order[:MOST_RUNS]
    ]
    more = f" and {len(order) - MOST_RUNS} more" if len(order) > MOST_RUNS else ""
    return (
        f"the refined model errs more than the base model in {len(rising)} of {len(errors)} held-out comparisons: "
        f"{', '.join(told)}{more}; what was accepted does not hold there",
    )
