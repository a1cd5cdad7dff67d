"""Accepted effects that a recording error could equally cause (offset, scale, latency), with the line that corrects it.

    sensor_bias     y = q + b          offset = -b
    sensor_scale    y = (1 + s) q      scale = 1 / (1 + s)
    sensor_delay    y = q(t - T)       latency = T
    actuator_delay  f = f(u(t - T))    latency = T of every signal

The model is driven by the commands that were logged, whether a controller made them or nobody: the replay is the same
whether all commands act late or all signals are stamped late, and only the one who knows the recorder can tell. With
several actuators that needs one delay in all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from onlinebayes.criticism.results import Candidate
from onlinebayes.identification.results import Estimate

UNIT = {"sensor_bias": "bias", "sensor_scale": "scale", "sensor_delay": "delay", "actuator_delay": "delay"}
PARTED_STANDARD_ERRORS = 3.0  # standard errors between the delays of two actuators


@dataclass(frozen=True)
class _Named:
    """An effect of the log or the machine: its name, its target and its size."""

    name: str
    target: str
    size: Estimate


def log_notes(
    candidates: Sequence[Candidate],
    parameters: Mapping[str, Estimate],
    commands: Sequence[str],
    signals: Sequence[str],
) -> tuple[str, ...]:
    """A sentence for each accepted effect, or equal of one, that a line of the problem file would put right.

    Args:
        candidates: as ranked.
        parameters: of the final model.
        commands, signals: names of all actuators and all measured signals.
    """
    named = [one for candidate in candidates if (one := _named(candidate, parameters)) is not None]
    notes = [_of_signal(one) for one in named if one.name != "actuator_delay"]
    late = [one for one in named if one.name == "actuator_delay"]
    if late and len(late) == len(commands) and _alike([one.size for one in late]):
        notes.append(_late(late, signals))
    return tuple(notes)


def _named(candidate: Candidate, parameters: Mapping[str, Estimate]) -> _Named | None:
    name, _, target = candidate.effect.partition("@")
    if name not in UNIT or not (candidate.accepted or candidate.indistinguishable_from):
        return None
    fitted = candidate.parameters.get(UNIT[name])
    size = parameters.get(f"{candidate.effect}.{UNIT[name]}", fitted)
    return None if size is None else _Named(name, target, size)


def _of_signal(one: _Named) -> str:
    mean = one.size.mean
    says, line = {
        "sensor_bias": (f"its zero {mean:.3g} {one.size.unit} off", f"offset = {-mean:.4g}"),
        "sensor_scale": (f"its scale {100 * mean:.3g} % off", f"scale = {1 / (1 + mean):.6g}"),
        "sensor_delay": (f"been logged {1e3 * mean:.3g} ms late", f"latency = {mean:.4g}"),
    }[one.name]
    return f'{one.target} may have {says}: then [signals."{one.target}"] {line} in the problem file puts it right'


def _late(late: Sequence[_Named], signals: Sequence[str]) -> str:
    mean = sum(one.size.mean for one in late) / len(late)
    where = ", ".join(f'[signals."{signal}"]' for signal in signals)
    who = "the command acts" if len(late) == 1 else "all commands act"
    return (
        f"whether {who} {1e3 * mean:.3g} ms late or all signals are logged that much late, a replay driven by the "
        f"logged commands does not tell; if it is the log: latency = {mean:.4g} under {where}"
    )


def _alike(sizes: Sequence[Estimate]) -> bool:
    """Whether all delays may be one."""
    means = [size.mean for size in sizes]
    return max(means) - min(means) <= PARTED_STANDARD_ERRORS * max(size.sd for size in sizes) or len(sizes) == 1
