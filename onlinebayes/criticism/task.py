"""A user's arguments prepared for fitting: model and runs on one clock, runs split, the window length chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from onlinebayes.identification.data.motion import check_runs
from onlinebayes.identification.data.windows import joint_names
from onlinebayes.identification.fitting.before_runs import idle_before
from onlinebayes.identification.fitting.closed_loops import completed, tied_as_logged
from onlinebayes.identification.fitting.gaps import held_over_gaps
from onlinebayes.identification.fitting.horizon import cut_to_runs, shortened, steady, within_runs
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.identification.replaying.clock import in_step, restepped
from onlinebayes.identification.replaying.scoped import scoped
from onlinebayes.identification.results import Selection
from onlinebayes.identification.scope import Scope
from onlinebayes.identification.splitting import split
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable

IDLE = (
    "the log does not say what was commanded before a run's first row; no command at all is taken: had the first row's "
    "command been given before, too, the model would follow the log less well"
)


@dataclass(frozen=True)
class Task:
    """A model and the runs that it is held against.

    Args:
        simulator: the base model, with what differs between runs.
        fit_runs, held_runs: the measurement, parted.
        selection: how effects are judged.
        notes: what was changed to make it ready, a sentence each.
    """

    simulator: Identifiable
    fit_runs: Measurement
    held_runs: Measurement
    selection: Selection
    notes: tuple[str, ...]

    def with_gaps(self, held: bool) -> Task:
        """The task with commands held over the log's gaps, or not."""
        fit_runs, held_runs = (replace(part, held_over_gaps=held) for part in (self.fit_runs, self.held_runs))
        return replace(self, fit_runs=fit_runs, held_runs=held_runs)

    @property
    def idle(self) -> Task:
        """The task with no command before the runs, where the first row's was taken to have been given already."""
        fit_runs, held_runs = (replace(part, idle_before=True) for part in (self.fit_runs, self.held_runs))
        return replace(self, fit_runs=fit_runs, held_runs=held_runs, notes=(*self.notes, IDLE))

    def reread(self, found: Identifiable) -> Task | None:
        """The task read as a model asks that was found, where that remembers commands; None where it asks nothing."""
        asks = not self.fit_runs.idle_before and idle_before(found, self.fit_runs, self.selection.horizon_s)
        return self.idle if asks else None


def prepare(
    simulator: Identifiable,
    measurement: Measurement,
    holdout: Sequence[str] | None,
    selection: Selection | None,
    scope: Scope | None,
) -> Task:
    """The task that a user's arguments ask; see :func:`onlinebayes.criticism.commands.compare`."""
    asked = selection or Selection()
    measurement, tied = completed(simulator, measurement.seen())
    given, measurement = charted(simulator, measurement)
    fit_runs, held_runs = split(measurement, holdout)
    for part in (fit_runs, held_runs):
        check_runs(joint_names(given), part)
    stepped = in_step(given, fit_runs)
    within = within_runs(asked, fit_runs)
    used = steady(stepped, fit_runs, within)
    stepped = tied_as_logged(stepped, fit_runs, used.horizon_s)
    notes = (
        *tied,
        *restepped(given, stepped, fit_runs),
        *cut_to_runs(asked, within),
        *shortened(within, used),
    )
    model = scoped(stepped, scope, measurement, fit_runs.runs)
    task = Task(model, fit_runs, held_runs, used, notes)
    if held_over_gaps(stepped, fit_runs, used.horizon_s):
        task = task.with_gaps(held=True)
    return task.reread(stepped) or task
