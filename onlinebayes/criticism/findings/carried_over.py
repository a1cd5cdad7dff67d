"""What was accepted and does not hold in the held-out runs: the runs it makes worse, and the effect that does it.

Nothing is decided by the held-out runs, which are looked at once. But a law that serves the fit runs and not a run of
another kind is one that their user should know of: a mean over all held-out runs may hide it, and so may the effects
that were accepted before it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

from onlinebayes.criticism.searching.stage import Added
from onlinebayes.identification import quantities
from onlinebayes.identification.detail import WindowError
from onlinebayes.identification.fitting.heldout import replay_error, replay_runs
from onlinebayes.identification.replaying.ladder import Rung
from onlinebayes.identification.replaying.measured_starts import windows_to_replay
from onlinebayes.measurements import Measurement

RISES = 1.1  # times, in the geometric mean over the signals
MORE = 1.02  # times; windows are counted alike, whatever their rows
MOST_RUNS = 3  # that are named


def worse_runs_note(
    windows: Iterable[WindowError], units: Mapping[str, str], floors: Mapping[str, float]
) -> tuple[str, ...]:
    """A sentence that names the held-out runs in which the error rises, the worst first; nothing without any.

    An error within what noise explains is as small as any model's, whatever the base model's was.

    Args:
        windows: errors of the base and of the refined model.
        units: signal -> unit.
        floors: signal -> noise floor of the held-out error [the signal's unit].
    """
    squares: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for one in windows:
        if one.held_out:
            squares.setdefault((one.run, one.signal), []).append((one.before**2, one.after**2))
    errors = {
        place: tuple(math.sqrt(sum(pair[k] for pair in pairs) / len(pairs)) for k in (0, 1))
        for place, pairs in squares.items()
    }
    rising = {
        (run, signal): (before, after)
        for (run, signal), (before, after) in errors.items()
        if after > MORE * before and not after <= floors[signal]
    }
    if not rising:
        return ()
    order = sorted(rising, key=lambda place: -rising[place][1] / max(rising[place][0], 1e-300))
    told = [
        f"{signal} in “{run}” {' → '.join(quantities.texts(rising[run, signal], units[signal]))}"
        for run, signal in order[:MOST_RUNS]
    ]
    more = f" and {len(order) - MOST_RUNS} more" if len(order) > MOST_RUNS else ""
    return (
        f"the refined model errs more than the base model in {len(rising)} of {len(errors)} held-out comparisons: "
        f"{', '.join(told)}{more}; what was accepted does not hold there",
    )


Errors = Mapping[str, float]
"""Held-out error by signal [the signal's unit]."""


def errors_on_the_way(
    accepted: Sequence[Added], rung: Rung, held_runs: Measurement, horizon: float
) -> tuple[tuple[str, Errors], ...]:
    """The effects that were accepted, all but the last, and the held-out error of the model that each of them made.

    Without the first of a pair, which was not admissible alone.

    Args:
        accepted: the effects with the rounds that added them.
        rung: by which all are run.
        held_runs: the runs.
        horizon: of a window [s].
    """
    names = tuple(signal.name for signal in held_runs.signals)
    errors = []
    for stage, judged in accepted[:-1]:
        if not judged.admissible:
            continue
        model, theta = rung.of(judged.fitted.simulator), judged.fitted.theta
        windows = windows_to_replay(model, held_runs, theta, horizon, stage.windows.noise)
        errors.append((judged.effect.key, replay_error(replay_runs(model, windows, theta, held_out=True), names)))
    return tuple(errors)


def in_vain_note(
    before: Errors, on_the_way: Sequence[tuple[str, Errors]], last: str, after: Errors, units: Mapping[str, str]
) -> tuple[str, ...]:
    """A sentence on the effect with which the held-out error rises most, by a tenth at least; nothing without any.

    Args:
        before: of the base model.
        on_the_way: of :func:`errors_on_the_way`.
        last: the last effect that was accepted.
        after: of the final model.
        units: signal -> unit.
    """
    chain = [("", before), *on_the_way, (last, after)]
    steps = [(_rise(a, b), key, a, b) for (_, a), (key, b) in pairwise(chain)]
    rise, key, a, b = max(steps, key=lambda one: one[0])
    if not rise > RISES:
        return ()
    worst = max(a, key=lambda signal: b[signal] / a[signal] if a[signal] > 0 else 0.0)
    was, now = quantities.texts((a[worst], b[worst]), units[worst])
    return (
        f"with {key} the held-out error rises ({worst}: {was} → {now}): it serves the runs that were fitted and does "
        "not carry over to these. Do not rely on it; [effects] candidates without it leaves it out",
    )


def _rise(before: Errors, after: Errors) -> float:
    """By how many times the error rises, in the geometric mean over the signals that both have."""
    ratios = [after[signal] / before[signal] for signal in before if before[signal] > 0 and after[signal] > 0]
    finite = [ratio for ratio in ratios if not math.isnan(ratio)]
    return math.exp(sum(map(math.log, finite)) / len(finite)) if finite else 1.0
