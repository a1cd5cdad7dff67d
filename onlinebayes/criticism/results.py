"""Results of criticism, as frozen values: the verdict, the ranked effects, the errors, and the replays behind them.

Everything that report.json, the HTML report and the recording show stands here; nothing in these classes computes. The
exact rules are in ``hypotheses``: the verdict in ``verdict``, ``score_gain`` in ``scoring``, what is added in ``rule``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from onlinebayes.identification.results import Estimate, FittedModel

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
"""The command that asks."""

MOVES_NOTHING = "nothing moves"
"""In place of the parameters that do the same: no measured signal moves with the effect."""

NOT_NEEDED = "not needed"
"""Why a candidate that gains enough is not in the model: another one explains more."""

UNDETERMINED = "its interval holds no effect"
"""Why a candidate that was added once is not in the model."""

CONTRADICTED = "the held-out error rises with it"
"""Why a candidate that explains the runs that were fitted is not in the model."""


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
        probability: that it is in the machine; None of what is neither in the model nor equal to what is.
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
    probability: float | None = None
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
    """A region where the error concentrates, with ``share_of_error`` of the squared error of one signal."""

    signal: str
    where: str
    share_of_error: float
    share_of_time: float


@dataclass(frozen=True)
class Remainder:
    """The error left by the final model, by signal: start-projected RMS over the floor, and where it concentrates."""

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


DelayStage = Literal["command", "torque", "sensor", "clock"]
"""Where a delay may be: transport of the command, lag of the torque, the sensor, the clock of its stamps."""

DelayRecording = Literal["second_sensor", "release", "step", "minute"]
"""What parts stages of a delay: a second sensor or the current, a motion that starts without the command at a known
instant, steps of the command, a minute of motion for the rate of a clock."""


@dataclass(frozen=True)
class DelayPlace:
    """One stage at which a delay may be.

    Args:
        stage: which.
        effect: key of what stands for it, the best that was tried; empty where nothing was.
        told_apart: whether the log tells it from what was found; None of what was found, and where it is not decided.
    """

    stage: DelayStage
    effect: str
    told_apart: bool | None


@dataclass(frozen=True)
class DriftSeen:
    """What the log says of the drift of a signal's clock.

    Args:
        signal: its name.
        rate, sd: by which its lag grows, beside a delay that was found [s/s].
        sd_of_a_minute: the sd that one run of 60 s of such motion would give [s/s].
    """

    signal: str
    rate: float
    sd: float
    sd_of_a_minute: float


@dataclass(frozen=True)
class LocatedDelay:
    """A delay that was found, and what this log tells of the stage at which it is.

    Args:
        found: key of the effect, or the fault of the log in words.
        stage: at which it is, as it was found.
        places: all four stages, in the order from the command to the log.
        recordings: which would tell apart what this log does not.
        drift: of the signal's clock; None where that is not known.
    """

    found: str
    stage: DelayStage
    places: tuple[DelayPlace, ...]
    recordings: tuple[DelayRecording, ...]
    drift: DriftSeen | None = None


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
