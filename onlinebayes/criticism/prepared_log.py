"""A user's arguments prepared for fitting: model and runs on one clock, runs split, the window length chosen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from onlinebayes.criticism.wiring.readings import Constraints, Reading, SoftConstraints, in_words, other_readings
from onlinebayes.identification.data.motion import check_runs
from onlinebayes.identification.data.windows import joint_names
from onlinebayes.identification.fitting.closed_loops import completed
from onlinebayes.identification.fitting.horizon import cut_to_runs, shortened, steady, within_runs
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.identification.replaying.clock import in_step, restepped
from onlinebayes.identification.replaying.scoped import scoped
from onlinebayes.identification.results import Selection
from onlinebayes.identification.scope import Scope
from onlinebayes.identification.splitting import split
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class PreparedLog:
    """A model and the runs that it is held against.

    Args:
        simulator: the base model, with what differs between runs.
        fit_runs, held_runs: the measurement, parted.
        selection: how effects are judged.
        prepared: what was changed to make it ready, a sentence each.
        constraints: how the model's constraints are taken.
        soft: the base model with constraints as soft as its file has them, where it has any.
        readings: which other readings were taken.
        given: the model as the user gave it.
    """

    simulator: Identifiable
    fit_runs: Measurement
    held_runs: Measurement
    selection: Selection
    prepared: tuple[str, ...]
    constraints: Constraints = "none"
    soft: Identifiable | None = None
    readings: tuple[Reading, ...] = ()
    given: Identifiable | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the changes that made the log ready, and on how it is read where it does not say."""
        found = filter(None, (reading.note for reading in self.readings))
        return (*self.prepared, *in_words(self.fit_runs, self.constraints), *found)

    def other_readings(self, found: Identifiable) -> Iterator[Reading]:
        """Yield the other readings of the runs that a model which was found asks for."""
        return other_readings(found, self.fit_runs, self.soft if self.constraints == "rigid" else None)

    def read(self, reading: Reading) -> PreparedLog:
        """The task with its runs read so."""
        return replace(
            self,
            simulator=reading.model(self.simulator),
            fit_runs=reading.correct(self.fit_runs),
            held_runs=reading.correct(self.held_runs),
            constraints="soft" if isinstance(reading, SoftConstraints) else self.constraints,
            readings=(*self.readings, reading),
        )


def prepare(
    simulator: Identifiable,
    measurement: Measurement,
    holdout: Sequence[str] | None,
    selection: Selection | None,
    scope: Scope | None,
) -> PreparedLog:
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
    rigid = stepped.with_rigid_constraints()
    prepared = (
        *tied,
        *restepped(given, stepped, fit_runs),
        *cut_to_runs(asked, within),
        *shortened(within, used),
    )
    model, soft = (scoped(one, scope, measurement, fit_runs.runs) for one in (rigid, stepped))
    if rigid is stepped:
        return PreparedLog(model, fit_runs, held_runs, used, prepared, given=simulator)
    return PreparedLog(model, fit_runs, held_runs, used, prepared, "rigid", soft, given=simulator)
