"""Where a delay is: at which of four stages, what this log tells apart, and which recording would.

    command u -> transport u(t - T) -> torque lag -> machine -> sensor q(t - T) -> clock of its stamps -> log

The laws of a machine do not change with the time of day: driven in open loop from rest, a late command and a late
sensor give the same table. What parts them starts at a known instant without passing through the command, or shows what
has. No fit is made: what the search tried beside what it added says which stages do as well (see ``rounds``), and what
is left beside the found delay says whether a clock drifts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.growing_lags import LagGrowth, lag_growths
from onlinebayes.criticism.hypotheses.ranking import equals, laws
from onlinebayes.criticism.hypotheses.rounds import Round
from onlinebayes.criticism.results import DelayPlace, DelayRecording, DelayStage, DriftSeen, LocatedDelay
from onlinebayes.criticism.wiring.faults import Fault
from onlinebayes.criticism.wiring.shifts import Shifted
from onlinebayes.identification.judging.rule import SHARE_OF_GAINED
from onlinebayes.identification.results import Estimate
from onlinebayes.identification.scope import address_of

STAGES: Mapping[str, DelayStage] = {
    "actuator_delay": "command",
    "actuator_lag": "torque",
    "sensor_delay": "sensor",
    "sensor_clock": "clock",
}
"""Effect -> its stage, in the order of the way from the command to the log."""

MINUTE = 60.0
"""Seconds of the recording that is proposed for a clock."""


def located_delays(explanation: Explanation, parameters: Mapping[str, Estimate]) -> tuple[LocatedDelay, ...]:
    """Every delay of what was found, with what the log says of the other stages.

    Args:
        explanation: the search.
        parameters: of the final model, by name.
    """
    kept = [key for key in laws(explanation.found.hypothesis) if stage_of(key) is not None]
    rounds = {one.added.addition.key: one for one in explanation.rounds if one.added is not None}
    late = [key for key in kept if key in rounds]
    if not late:
        return ()
    drifts = {one.signal: one for one in lag_growths(explanation.found.fitted, explanation.windows)}
    for key in late:
        signal, rate = key.partition("@")[2], parameters.get(f"{key}.rate")
        if stage_of(key) == "clock" and signal in drifts and rate is not None:
            drifts[signal] = replace(drifts[signal], rate=rate.mean, sd=rate.sd)
    return tuple(_located(key, rounds[key], kept, drifts, parameters) for key in late)


def ahead_of_commands(fault: Fault) -> tuple[LocatedDelay, ...]:
    """What the stages have to do with signals that run ahead of the commands: none but the clocks does that."""
    if not (isinstance(fault, Shifted) and fault.every and fault.rows < 0):
        return ()
    places = tuple(DelayPlace(stage, "", stage != "clock") for stage in STAGES.values())
    return (LocatedDelay(fault.says, "clock", places, ()),)


def stage_of(key: str) -> DelayStage | None:
    """The stage that an effect delays; None of one that delays nothing."""
    return STAGES.get(key.partition("@")[0])


def _located(
    key: str, found: Round, kept: list[str], drifts: Mapping[str, LagGrowth], parameters: Mapping[str, Estimate]
) -> LocatedDelay:
    own = stage_of(key)
    assert own is not None
    drift = drifts.get(key.partition("@")[2]) or min(drifts.values(), key=lambda one: one.sd, default=None)
    places = []
    for stage in STAGES.values():
        place = DelayPlace(stage, key, None) if stage == own else _place(key, stage, found, kept)
        if stage == "clock" and stage != own and not place.effect and drift is not None:
            place = DelayPlace(stage, "", _is_no_drift(drift, _size(key, parameters)))
        places.append(place)
    seen = None if drift is None else DriftSeen(drift.signal, drift.rate, drift.sd, drift.sd_after(MINUTE))
    return LocatedDelay(key, own, tuple(places), tuple(_recordings(own, places)), seen)


def _place(key: str, stage: DelayStage, found: Round, kept: list[str]) -> DelayPlace:
    """Whether a stage does as well as what was added, by the best of its effects that the same round tried."""
    if same := [other for other in equals(found) if stage_of(other) == stage]:
        return DelayPlace(stage, same[0], False)
    if there := [other for other in kept if stage_of(other) == stage]:
        return DelayPlace(stage, there[0], True)
    tried = {one.addition.key: one.least for one in found.tried if stage_of(one.addition.key) == stage}
    if tried:
        return DelayPlace(stage, max(tried, key=tried.__getitem__), True)
    promised = {one.addition.key: one.gain for one in found.screened}
    mine = {other: gain for other, gain in promised.items() if stage_of(other) == stage}
    if not mine:
        return DelayPlace(stage, "", None)
    best = max(mine, key=mine.__getitem__)
    behind = key in promised and mine[best] < (1 - SHARE_OF_GAINED) * promised[key]
    return DelayPlace(stage, best, True if behind else None)


def _size(key: str, parameters: Mapping[str, Estimate]) -> float:
    """The size of a delay, the largest where runs have their own [s]."""
    own = [value.mean for name, value in parameters.items() if address_of(name).startswith(f"{key}.")]
    return max(map(abs, own), default=0.0)


def _is_no_drift(drift: LagGrowth, size: float) -> bool | None:
    """True where a clock that drifts to twice the delay by the end of the log would have been seen; None if not."""
    return True if (abs(drift.rate) + 2 * drift.sd) * drift.span < 2 * size else None


def _recordings(own: DelayStage, places: list[DelayPlace]) -> Iterator[DelayRecording]:
    """What parts the stages that this log does not."""
    left = {own, *(place.stage for place in places if place.told_apart is not True)}
    if "sensor" in left and left & {"command", "torque"}:
        yield from ("second_sensor", "release")
    if left >= {"command", "torque"}:
        yield "step"
    if "clock" in left:
        yield "minute"
