"""What criticism finds, as frozen values: the verdict, the ranked effects, the errors, and the replays behind them.

Everything that report.json, the HTML report and the recording show stands here; nothing in these classes computes. The
exact rules are in ``hypotheses``: the verdict in ``verdict``, ``score_gain`` in ``scoring``, what is added in ``rule``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from onlinebayes.criticism.timing import Timing
from onlinebayes.identification.detail import Detail
from onlinebayes.identification.results import Estimate, FittedModel, FlatDirection, Numerics, Selection

Verdict = Literal[
    "data_problem",
    "insufficient_data",
    "bounds_exclude_truth",
    "tie",
    "missing_effect",
    "unexplained",
    "adequate",
]


Question = Literal["compare", "diagnose", "refine"]
"""Which command asks."""

MOVES_NOTHING = "nothing moves"
"""In place of the parameters that do the same: no measured signal moves with the effect."""

NOT_NEEDED = "not needed"
"""Why a candidate that gains enough is not in the model: another one explains more."""


@dataclass(frozen=True)
class Candidate:
    """One effect that was tried.

    Args:
        effect: ``name@target``.
        rank: 1 for the first; None where it is confounded with the free parameters.
        p_value: None: the search does not test against chance.
        score_gain, score_gain_se: cross-validated log score over the model without it, nats; None if not refitted.
        n_blocks: number of blocks B.
        accepted: whether it stands in the final model.
        refused_because: the rules it failed, in words; empty for accepted and unranked ones.
        parameters: short name -> estimate, from its own refit; empty if not refitted.
        indistinguishable_from: effects that explain the data equally.
        nested_in: richer effects that contain it.
        confounded_with: free parameters that do the same already, or :data:`MOVES_NOTHING`.
        exclusion_limit: smallest size of its first parameter that these data would have shown [that unit], or None.
    """

    effect: str
    rank: int | None
    p_value: float | None
    score_gain: float | None
    score_gain_se: float | None
    n_blocks: int
    accepted: bool = False
    refused_because: tuple[str, ...] = ()
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    indistinguishable_from: tuple[str, ...] = ()
    nested_in: tuple[str, ...] = ()
    confounded_with: tuple[str, ...] = ()
    exclusion_limit: float | None = None


@dataclass(frozen=True)
class Step:
    """One acceptance; errors are cross-validated inside the fit runs, signal -> RMS [the signal's unit]."""

    added: str
    error_before: Mapping[str, float]
    error_after: Mapping[str, float]
    score_gain: float
    score_gain_se: float
    n_blocks: int


@dataclass(frozen=True)
class Failure:
    """Where the error concentrates: a region that holds ``share_of_error`` of the squared error of one signal."""

    signal: str
    where: str
    share_of_error: float
    share_of_time: float


@dataclass(frozen=True)
class Remainder:
    """What is left after the final model, by signal: start-projected RMS over the floor, and where it concentrates."""

    status: Literal["noise", "structured"]
    rms_over_floor: Mapping[str, float]
    where: str


@dataclass(frozen=True)
class HeldOutError:
    """RMS over tiled windows of the held-out runs, signal -> value [the signal's unit]; ``horizon_s`` in seconds.

    ``before`` is the base model refitted, ``after`` the final one, each from the windows' best starts; ``noise_floor``
    is the sensors' noise.
    """

    before: Mapping[str, float]
    after: Mapping[str, float]
    noise_floor: Mapping[str, float]
    horizon_s: Mapping[str, float]


@dataclass(frozen=True)
class Wiring:
    """A fault between sensor and table that explains the misfit better than any effect.

    Args:
        fault: what is wrong, in words.
        lines: what to put in the problem file.
        error_before: cross-validated RMS of the model fitted to the table as it stands [that table's floors].
        error_after: the same with these lines, the model fitted anew [floors of the table put right].
        alternatives: (fault, lines) of those that explain as much.
    """

    fault: str
    lines: str
    error_before: float
    error_after: float
    alternatives: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class WidenedBounds:
    """Bounds of a parameter that exclude the truth, and wider ones that hold what the data ask for (low, high)."""

    before: tuple[float, float]
    after: tuple[float, float]


@dataclass(frozen=True)
class ParameterChange:
    """A parameter that differs between runs: no effect is missing, one value is not enough.

    Args:
        parameter: its address.
        values: run -> estimate.
        shared: the one value that the base model had for all.
        p_value: None; kept for readers of report.json.
        score_gain, score_gain_se: cross-validated log score over the model with one value, nats.
        n_blocks: number of blocks B.
        rms_fall: share by which the cross-validated error falls at the long and the short horizon.
        equals: other parameters whose own values explain as much.
        lines: what to put in the problem file.
    """

    parameter: str
    values: Mapping[str, Estimate]
    shared: float
    p_value: float | None
    score_gain: float
    score_gain_se: float
    n_blocks: int
    rms_fall: tuple[float, float]
    equals: tuple[str, ...]
    lines: str


@dataclass(frozen=True)
class WeightedModel:
    """A hypothesis that the data leave open, fitted.

    Args:
        weight: how far it is to be believed, between 0 and 1; those of all hypotheses add up to 1.
        accepted: what it adds to the base model.
        model: without replays, but for the final one.
    """

    weight: float
    accepted: tuple[str, ...]
    model: FittedModel


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
        holdout_looks: how often the held-out runs have been opened; a command opens them once.
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
        mended: with ``data_problem``, the base model fitted to the mended table, without replays.
        hypotheses: the final model, and those that the data cannot tell from it, each with its weight.
        failed: what failed in the work, a line each; the answer is the best that was known without it.
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
    mended: FittedModel | None = None
    hypotheses: tuple[WeightedModel, ...] = ()
    failed: tuple[str, ...] = ()

    @property
    def only_compared(self) -> bool:
        """Whether the model errs and nobody has asked why."""
        return self.command == "compare" and self.verdict == "unexplained"

    @property
    def changed(self) -> bool:
        """Whether the final model is another than the base model."""
        return self.final is not self.base

    @property
    def held_out_runs(self) -> tuple[str, ...]:
        """Names of the runs that were kept for the reported error."""
        return tuple(replay.run for replay in self.final.replays if replay.held_out)
