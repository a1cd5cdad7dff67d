"""The answer of ``compare``, ``diagnose`` and ``refine`` as one frozen value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.results import (
    Candidate,
    Failure,
    HeldOutError,
    LocatedDelay,
    ParameterChange,
    Question,
    Remainder,
    Step,
    Verdict,
    WeightedModel,
    WidenedBounds,
    Wiring,
)
from onlinebayes.criticism.timing import Timing
from onlinebayes.identification.detail import Detail
from onlinebayes.identification.fleet import Fleet
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.identification.results import Estimate, FittedModel, FlatDirection, Numerics, Selection
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Criticism:
    """The answer of ``compare``, ``diagnose`` or ``refine``; the fields up to ``numerics`` are report.json's.

    Args:
        command: which of the three made this.
        verdict: what is wrong; from ``compare``, which tries no effect, ``unexplained`` where the model errs.
        accepted: keys of the effects added, in order (those added by hand belong to the base model).
        remainder: what the final model leaves in the fit runs.
        heldout_error: of both models over the held-out runs.
        steps: the acceptances, in order.
        candidates: every effect that was tried, ranked ones first.
        candidates_tried: how many these were.
        holdout_looks: how often the held-out runs were opened: once, and once more for each addition that went.
        failures: where the base model's error concentrates, the worst regions of each signal first.
        parameters: address -> estimate, of the final model.
        flat_directions: combinations of the final model's parameters that the fit runs do not determine.
        numerics: whether the final model's integration step is fine enough.
        base, final: the base model refitted and the accepted one (the same object where nothing was accepted).
        signals: names of the S signals that were compared, in the order of the replays' columns.
        commands: names of the U actuators, in the order of the replays' commands.
        units: signal -> unit.
        sensor_sd: signal -> sensor noise used, given or estimated [the signal's unit].
        selection: how effects were judged, with the horizon that was used in the end.
        what_to_record: with ``insufficient_data``, what would decide; else empty.
        interrupted: whether the search was stopped before its end.
        notes: what else a reader should know, a sentence each.
        widened: parameter -> bounds, with ``bounds_exclude_truth``; ``final`` is then the model within the wider ones.
        detail: the held-out error window by window and over time, and how the error spreads over what the machine did.
        timings: the stages of the work and how long each took, up to the result.
        wiring: with ``data_problem`` (from ``compare``: where it is suspected, too), the fault and what mends it.
        changes: the parameters that differ between runs; the ``final`` model has one value a run of each.
        corrected: with ``data_problem``, the base model fitted to the corrected table, without replays.
        read_as: the lines of a problem file that read the log as it was read here, where it does not say how.
        hypotheses: the final model, and those that the data cannot tell from it, each with its weight.
        fleet: address -> how far it differs between units, and what the next unit's may be; of the final model.
        contradicted: what was added and taken out again, for the held-out error rises with it.
        held_out_gain: of what stayed, over the base model on the held-out runs [nats]; not a number without any.
        failed: what failed in the work, a line each; the answer is the best that was known without it.
        delays: what was found that delays something, and at which stages this log would let it be.
        file_error: signal -> held-out error of the final model as a file of its engine holds it, from ``refine``; empty
            where there is no such file, or where that is not known.
        given: the model as the user gave it.
        integration: how the base and the final model are run.
        explanation: the evaluations that it stands on, for :func:`~onlinebayes.criticism.next_experiment`.
    """

    command: Question
    verdict: Verdict
    accepted: tuple[str, ...]
    remainder: Remainder
    heldout_error: HeldOutError
    steps: tuple[Step, ...]
    candidates: tuple[Candidate, ...]
    candidates_tried: int
    holdout_looks: int
    failures: tuple[Failure, ...]
    parameters: Mapping[str, Estimate]
    flat_directions: tuple[FlatDirection, ...]
    numerics: Numerics
    base: FittedModel
    final: FittedModel
    signals: tuple[str, ...]
    commands: tuple[str, ...]
    units: Mapping[str, str]
    sensor_sd: Mapping[str, float]
    selection: Selection
    what_to_record: str = ""
    interrupted: bool = False
    notes: tuple[str, ...] = ()
    widened: Mapping[str, WidenedBounds] = field(default_factory=dict)
    detail: Detail = field(default_factory=Detail)
    timings: tuple[Timing, ...] = ()
    wiring: Wiring | None = None
    changes: tuple[ParameterChange, ...] = ()
    corrected: FittedModel | None = None
    read_as: str = ""
    hypotheses: tuple[WeightedModel, ...] = ()
    fleet: Mapping[str, Fleet] = field(default_factory=dict)
    contradicted: tuple[str, ...] = ()
    held_out_gain: float = math.nan
    failed: tuple[str, ...] = ()
    delays: tuple[LocatedDelay, ...] = ()
    file_error: Mapping[str, float] = field(default_factory=dict)
    integration: Integration | None = None
    given: Identifiable | None = field(default=None, repr=False, compare=False)
    explanation: Explanation | None = field(default=None, repr=False, compare=False)

    @property
    def only_compared(self) -> bool:
        """True if the model errs and nobody has asked why."""
        return self.command == "compare" and self.verdict == "unexplained"

    @property
    def changed(self) -> bool:
        """True if the final model is another than the base model."""
        return self.final is not self.base

    @property
    def held_out_runs(self) -> tuple[str, ...]:
        """Names of the runs that were kept for the reported error."""
        return tuple(replay.run for replay in self.final.replays if replay.held_out)
