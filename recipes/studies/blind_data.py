"""The blind sets as criticism takes them: the engineer's model of the rig and one measurement, the truth kept apart."""

from __future__ import annotations

from dataclasses import dataclass

from envs.driven_pendulum import KINDS, MODEL, MeasuredSet, blind_sets
from envs.driven_pendulum.rig import DAMPING, MASS
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace

FREE = ParameterSpace({MASS: Parameter(0.1, 1.0, "kg"), DAMPING: Parameter(0.0, 0.1, "N m s/rad")})


@dataclass(frozen=True)
class BlindCase:
    """One case of the study.

    Args:
        kind, seed: what made it.
        measurement: all runs.
        holdout: names of the runs to open once.
        hidden: the right name, ``effect@target``, or None; for the judge.
        truth: every parameter of the rig under the model's addresses [SI]; for the judge.
    """

    kind: str
    seed: int
    measurement: Measurement
    holdout: tuple[str, ...]
    hidden: str | None
    truth: dict[str, float]


def cases(kinds: tuple[str, ...] = KINDS, seeds: range = range(10)) -> list[BlindCase]:
    """All sets of these kinds and seeds, recorded at once (about a third of a second a set)."""
    wanted = [(kind, seed) for kind in kinds for seed in seeds]
    return [
        BlindCase(kind, seed, to_measurement(made), made.holdout, made.hidden, dict(made.truth))
        for (kind, seed), made in zip(wanted, blind_sets(wanted), strict=True)
    ]


def to_measurement(made: MeasuredSet) -> Measurement:
    """The set as the library's own type, with the encoder's resolution and noise as its data sheet would give them."""
    columns = {
        run: {"time": made.times.numpy(), "ctrl.motor": command.numpy(), "qpos.hinge": angle.numpy()}
        for run, command, angle in zip(made.runs, made.command, made.angle, strict=True)
    }
    angle = Signal("qpos.hinge", "rad", sd=made.encoder.floor, resolution=made.encoder.resolution)
    return Measurement.from_runs(columns, signals=[angle], commands=["motor"])


__all__ = ["FREE", "KINDS", "MODEL", "BlindCase", "cases", "to_measurement"]
