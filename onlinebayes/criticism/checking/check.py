"""New logs of a machine against its refined model: does the model still hold, what changed, and since when.

reference: all runs of the refined problem, the model fitted to them   new: the runs of the new logs, nothing fitted
1 windows of both, each from its best start, and what each change would do there           (:mod:`.held`)
2 the change that explains most of what rings; its size by a replay; made good, then the next one (:mod:`.judging`)
3 is what is left larger than the reference's error
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.checking.asked import Applied, Asked
from onlinebayes.criticism.checking.held import Held, Scores, hold
from onlinebayes.criticism.checking.judging import Reference, error_rise, strongest
from onlinebayes.criticism.checking.results import FALSE_ALARMS, Check, ErrorNow
from onlinebayes.criticism.checking.told import change_of, drifts_of
from onlinebayes.criticism.checking.what_may_change import additions_to, directions
from onlinebayes.criticism.hypotheses.explanation import explanation_of
from onlinebayes.criticism.prepared_log import PreparedLog, prepare
from onlinebayes.criticism.reading import begun_as_read
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.window_length import all_windows
from onlinebayes.identification.judging.scoring import FEWEST_RUNS, STRETCHES, folds_of
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement, concatenate
from onlinebayes.runs import BadInput, Memo, Watch, one_torch_thread
from onlinebayes.simulators.identifiable import Identifiable

MOST_CHANGES = 3
"""Changes that are told, each beside those before it."""


def check(
    simulator: Identifiable,
    covariance: Float[Tensor, "P P"],
    reference: Measurement,
    new: Measurement,
    *,
    selection: Selection | None = None,
    watch: Watch | None = None,
    memo: Memo | None = None,
) -> Check:
    """Hold new runs against a refined model.

    Args:
        simulator: the refined model.
        covariance: of its parameters, in their order [SI].
        reference: the runs that it was refined on, held-out ones among them.
        new: other runs of the same signals and commands, in the order of time.
        selection: as the model was judged.
        watch: told what is being done; ends the work at its next replay where it is interrupted.
        memo: keeps the fit of the reference for the next check.

    Raises:
        BadInput: a log does not suit the model, or the model diverges over it.
        Stopped: it was interrupted.
    """
    watch = watch or Watch()
    with one_torch_thread(), watch.heeded():
        watch.say("making model and logs ready")
        task = prepare(simulator, concatenate([reference, new]), new.runs, selection, None)
        task, search = begun_as_read(task, watch, memo)
        watch.say("fitting the reference to all windows")
        base = explanation_of(search).on_all_windows(task.fit_runs)
        windows, fitted = base.evaluator.windows, base.found.fitted
        watch.say("holding the logs against the model")
        held = hold(fitted.simulator, windows, fitted.theta, fitted.rows.weight)
        fresh = all_windows(task.simulator, task.held_runs, windows.horizon, windows.noise)
        if not bool(fresh.moving.any()):
            raise BadInput("nothing moves in the new log", "record it while the machine works")
        watch.say("asking what changed")
        return _answered(task, _asked(task, held, fresh, covariance), watch)


def _asked(task: PreparedLog, held: Held, windows: Windows, covariance: Float[Tensor, "P P"]) -> Asked:
    changes, columns = directions(held, additions_to(task.simulator, task.fit_runs))
    old = Scores.of(held, columns)
    reference = Reference.of(old, folds_of(held.windows), covariance.to(old.u))
    return Asked(changes, held, old, reference, held.simulator, windows, stretches(windows))


def _answered(task: PreparedLog, asked: Asked, watch: Watch) -> Check:
    new, squares = asked.left(())
    applied, left = _changes(asked, new, squares, watch)
    ratio, p = error_rise(asked.held.squares, folds_of(asked.held.windows), left, asked.stretch)
    everywhere = torch.ones(asked.windows.count, dtype=torch.bool)
    names = [task.simulator.signals[column] for column in asked.windows.columns]
    rms = (asked.held.rms, asked.with_changes((), everywhere).rms)
    then, now = (dict(zip(names, one.tolist(), strict=True)) for one in rms)
    return Check(
        verdict="changed" if applied or p < FALSE_ALARMS / 2 else "holds",
        changes=tuple(change_of(asked, one) for one in applied),
        error=ErrorNow(then, now, ratio, p),
        drifts=drifts_of(asked, new, applied),
        units={signal.name: signal.unit for signal in task.fit_runs.signals},
        reference_runs=task.fit_runs.runs,
        new_runs=task.held_runs.runs,
        asked=len(asked.changes),
        notes=(*task.notes, *_notes(asked)),
    )


def _changes(
    asked: Asked, scores: Scores, squares: Float[Tensor, " V"], watch: Watch
) -> tuple[Sequence[Applied], Float[Tensor, " V"]]:
    """The changes that ring, one after the other, each made good before the next is asked; and the squares left."""
    applied: list[Applied] = []
    for _ in range(MOST_CHANGES):
        known = [one.found.change for one in applied]
        one = strongest(asked.reference, scores, asked.stretch, asked.windows.run, asked.room, FALSE_ALARMS / 2)
        if one is None or one.change in known:
            break
        watch.say(f"how far has {asked.changes[one.change].key} changed")
        grown = [*applied, Applied(one, one.size)]
        for which in reversed(range(len(grown))):  # the sizes before it were found without it
            grown[which] = Applied(grown[which].found, asked.grown(grown, which))
        try:
            scores, squares = asked.left(grown)
        except BadInput:
            return [*applied, Applied(one, one.size)], squares
        applied = grown
    return applied, squares


def stretches(windows: Windows) -> Int[Tensor, " V"]:
    """Number of each new window's stretch in the order of time: its run's, of few runs a part of one."""
    of = torch.unique_consecutive(windows.run, return_inverse=True)[1]
    count = int(of.max()) + 1
    if count >= FEWEST_RUNS:
        return of
    each = -(-STRETCHES // count)
    place = torch.zeros_like(of)
    for r in range(count):
        mine = (of == r).nonzero()[:, 0]
        place[mine] = r * each + torch.arange(len(mine)) * each // len(mine)
    return torch.unique(place, return_inverse=True)[1]


def _notes(asked: Asked) -> list[str]:
    if asked.held.windows.run.unique().numel() >= FEWEST_RUNS:
        return []
    return ["the reference has few runs: how far the machine differs from run to run is not known"]
