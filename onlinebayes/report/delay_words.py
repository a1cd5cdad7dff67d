"""A delay that was found, in words: what the log says of each stage where it may be, and which recording says more."""

from __future__ import annotations

from typing import Final

from onlinebayes.criticism import DelayPlace, DelayRecording, DelayStage, DriftSeen, LocatedDelay
from onlinebayes.identification import quantities
from onlinebayes.report.phrases import plain

STAGES: Final[dict[DelayStage, str]] = {
    "command": "transport of the command",
    "torque": "lag of the torque",
    "sensor": "sensor",
    "clock": "clock of the signals",
}

NOTE = (
    "A machine's laws do not change with the time of day: driven in open loop from rest, a late command and a late "
    "sensor give the same table. A constant offset of a signal's clock is a late sensor; its drift is not."
)

RECORDINGS: Final[dict[DelayRecording, str]] = {
    "second_sensor": "To tell command and sensor apart, log a second sensor of the same joint, or the motor's current, "
    "by the same clock: it is as late as the command, and not as the sensor.",
    "release": "So does a motion that starts at a known instant without the command: the motor switched off while it "
    'moves (the column "enable.ACTUATOR"), or a release by hand from a start that stands under [starts].',
    "step": "To tell a delay of the command from a lag of the torque, record steps of the command, with several rows "
    "to the delay: after a delay nothing moves at first, with a lag all moves at once, and slowly.",
    "minute": "For the rate of a clock, record one run of 60 s of fast motion",
}


def found(delay: LocatedDelay) -> str:
    """``actuator delay at motor``; the fault of a log as it is."""
    return plain(delay.found)


def rows(delay: LocatedDelay) -> list[tuple[str, str, str]]:
    """The stage, what stands for it and what this log says of it, one row for each of the four."""
    return [(STAGES[place.stage], plain(place.effect) or "–", told(delay, place)) for place in delay.places]


def told(delay: LocatedDelay, place: DelayPlace) -> str:
    """What this log says of one stage."""
    if place.stage == delay.stage:
        return "found"
    drift = f": {_drift(delay.drift)}" if place.stage == "clock" and not place.effect and delay.drift else ""
    if place.told_apart is None:
        return f"not decided{drift}" if place.effect or drift else "not tried"
    return f"told apart{drift}" if place.told_apart else "not told apart: it explains as much"


def recordings(delay: LocatedDelay) -> list[str]:
    """One sentence for each recording that would tell apart what this log does not."""
    return [
        f"{RECORDINGS[kind]}{_sharper(delay.drift)}." if kind == "minute" else RECORDINGS[kind]
        for kind in delay.recordings
    ]


def _drift(drift: DriftSeen) -> str:
    return f"its lag grows by {quantities.significant(1e3 * drift.rate)} ± {_a_second(drift.sd)}"


def _sharper(drift: DriftSeen | None) -> str:
    return "" if drift is None else f": moving as here, it is then known to ± {_a_second(drift.sd_of_a_minute)}"


def _a_second(rate: float) -> str:
    """``0.0012 ms/s``."""
    return f"{quantities.significant(1e3 * rate)} ms/s"
