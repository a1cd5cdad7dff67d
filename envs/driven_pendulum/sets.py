"""Measured sets of the rig, as a laboratory would hand them over: a table of commands and encoder readings, no truth.

A set is R runs from rest; the base parameters are drawn off the model's nominal values, at most one effect is hidden,
the angle is read through an encoder:

    y = resolution round((q + noise) / resolution),      noise ~ N(0, sd^2)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from envs.driven_pendulum.excitation import excitation
from envs.driven_pendulum.rig import (
    DAMPING,
    DELAY,
    DRAG,
    FRICTION,
    MASS,
    NOMINAL,
    SPRINGREF,
    STIFFNESS,
    DrivenPendulumRig,
)
from onlinebayes.runs import BadInput, generator, write_atomic


@dataclass(frozen=True)
class Encoder:
    """An angle sensor.

    Args:
        sd: of its white noise, before rounding [rad].
        resolution: the step it rounds to [rad].
    """

    sd: float = 8e-4
    resolution: float = 2 * math.pi / 4096

    @property
    def floor(self) -> float:
        """Standard deviation of one reading, rounding included [rad]."""
        return math.hypot(self.sd, self.resolution / math.sqrt(12))

    def read(self, angle: Float[Tensor, "*shape"], draw: torch.Generator) -> Float[Tensor, "*shape"]:
        """Readings of true angles [rad]."""
        noisy = angle + self.sd * torch.randn(angle.shape, generator=draw, dtype=angle.dtype)
        return torch.round(noisy / self.resolution) * self.resolution


@dataclass(frozen=True)
class MeasuredSet:
    """Data that the laboratory hands over, and apart from them the truth.

    Args:
        runs: names of the R runs.
        holdout: those of them that are kept for the reported error.
        times: instants of the rows [s].
        command: motor torque, held from its row to the next [N m].
        angle: what the encoder read [rad].
        encoder: the sensor.
        truth: every parameter of the rig [SI]; for judges only.
        hidden: ``effect@target``, or None for a null set; for judges only.
    """

    runs: tuple[str, ...]
    holdout: tuple[str, ...]
    times: Float[Tensor, " T"]
    command: Float[Tensor, "R T"]
    angle: Float[Tensor, "R T"]
    encoder: Encoder
    truth: Mapping[str, float]
    hidden: str | None

    def write(self, path: str | Path) -> None:
        """Write the measurement table: run, time, ctrl.motor, qpos.hinge."""
        lines = ["run,time,ctrl.motor,qpos.hinge"]
        for run, command, angle in zip(self.runs, self.command.tolist(), self.angle.tolist(), strict=True):
            rows = zip(self.times.tolist(), command, angle, strict=True)
            lines += [f"{run},{time:.6g},{u:.9g},{q:.9g}" for time, u, q in rows]
        write_atomic(path, "\n".join(lines) + "\n")


@dataclass(frozen=True)
class Protocol:
    """Protocol by which a set is recorded.

    Args:
        fit, held: numbers of runs to fit and to hold out.
        seconds: length of a run [s].
        period: from one row to the next; the command is held over it [s].
        swing: least and greatest swing that the operator wants of a run [rad].
        encoder: the sensor.
    """

    fit: int = 10
    held: int = 2
    seconds: float = 5.0
    period: float = 0.005
    swing: tuple[float, float] = (0.9, 1.8)
    encoder: Encoder = Encoder()


# Sizes of the hidden effects, from least to greatest: with the standard protocol the refitted base model errs by
# 2 to 10 times the noise floor over one-second windows.
SIZES: Mapping[str, tuple[str, str, float, float]] = {
    "dry_friction": ("dry_friction@hinge", FRICTION, 0.009, 0.020),
    "quadratic_drag": ("quadratic_drag@hinge", DRAG, 0.0009, 0.0016),
    "joint_stiffness": ("joint_stiffness@hinge", STIFFNESS, 0.0065, 0.013),
    "actuator_delay": ("actuator_delay@motor", DELAY, 0.0040, 0.0065),
}
KINDS = (*SIZES, "null")
AMPLITUDES = tuple(0.04 * 1.35**k for k in range(10))  # what the operator tries in turn [N m]


def blind_set(kind: str, seed: int, protocol: Protocol | None = None) -> MeasuredSet:
    """One set with a hidden effect of that kind; see :func:`blind_sets`."""
    return blind_sets([(kind, seed)], protocol)[0]


def blind_sets(wanted: Sequence[tuple[str, int]], protocol: Protocol | None = None) -> list[MeasuredSet]:
    """Sets by (kind, seed), all recorded at once: one world of the rig a run.

    Args:
        wanted: kinds are dry_friction, quadratic_drag, joint_stiffness, actuator_delay and null; the same kind and
            seed give the same set, whatever stands beside it.
        protocol: how they are recorded.

    Raises:
        BadInput: an unknown kind.
    """
    protocol = protocol or Protocol()
    truths = [draw_truth(kind, seed) for kind, seed in wanted]
    return record([(truth, seed) for truth, (_, seed) in zip(truths, wanted, strict=True)], protocol)


def draw_truth(kind: str, seed: int) -> dict[str, float]:
    """Every parameter of a rig that hides an effect of this kind.

    Raises:
        BadInput: an unknown kind.
    """
    if kind not in KINDS:
        raise BadInput(f"kind '{kind}' is unknown", f"use one of {', '.join(KINDS)}")
    draw = generator(seed, f"driven pendulum, {kind}")
    mass, damping, size, ref = torch.rand(4, generator=draw, dtype=torch.float64).tolist()
    truth = {**NOMINAL, MASS: 0.28 + 0.28 * mass, DAMPING: 0.006 * 4**damping}
    if kind != "null":
        _, name, low, high = SIZES[kind]
        share = 1.0 if kind == "actuator_delay" else truth[MASS] / NOMINAL[MASS]  # torques grow with the bob
        truth[name] = (low + (high - low) * size) * share
    if kind == "joint_stiffness":
        truth[SPRINGREF] = 0.6 * (2 * ref - 1)
    return truth


def record(rigs: Sequence[tuple[Mapping[str, float], int]], protocol: Protocol) -> list[MeasuredSet]:
    """Drive rigs of given truths and read their encoders; the seeds decide commands, amplitudes and noise."""
    runs, sets = protocol.fit + protocol.held, len(rigs)
    times = torch.arange(round(protocol.seconds / protocol.period) + 1, dtype=torch.float64) * protocol.period
    rig = DrivenPendulumRig(dt=protocol.period)
    theta = torch.stack([rig.parameters.vector(truth) for truth, _ in rigs]).repeat_interleave(runs, 0)
    shape = torch.cat([excitation(runs, times, generator(seed, "excitation")) for _, seed in rigs])
    command = tuned(rig, theta, times, shape, torch.cat([_swings(runs, protocol.swing, seed) for _, seed in rigs]))
    command, angle = (table.unflatten(0, (sets, runs)) for table in (command, drive(rig, theta, times, command)))
    names = tuple(f"fit{k + 1}" for k in range(protocol.fit)) + tuple(f"held{k + 1}" for k in range(protocol.held))
    return [
        MeasuredSet(
            runs=names,
            holdout=names[protocol.fit :],
            times=times,
            command=command[k],
            angle=protocol.encoder.read(angle[k], generator(seed, "encoder")),
            encoder=protocol.encoder,
            truth=truth,
            hidden=_hidden(truth),
        )
        for k, (truth, seed) in enumerate(rigs)
    ]


def drive(
    rig: DrivenPendulumRig, theta: Float[Tensor, "M P"], times: Float[Tensor, " T"], command: Float[Tensor, "M T"]
) -> Float[Tensor, "M T"]:
    """True angles [rad] at the instants of the rows, from rest, each command held to the next row."""
    at_rest = TensorDict({}, batch_size=command.shape[:1])
    inputs = TensorDict({"command": command[:, :-1, None]}, batch_size=(len(command), len(times) - 1))
    moved = rig.rollout(theta, at_rest, inputs, times[1:])["qpos"][..., 0]
    return torch.cat([torch.zeros_like(moved[:, :1]), moved], dim=1)


def tuned(
    rig: DrivenPendulumRig,
    theta: Float[Tensor, "M P"],
    times: Float[Tensor, " T"],
    shape: Float[Tensor, "M T"],
    swing: Float[Tensor, " M"],
) -> Float[Tensor, "M T"]:
    """Commands of the given shapes, turned up step by step until the rig would swing farther than that [rad]."""
    levels = torch.tensor(AMPLITUDES, dtype=shape.dtype)
    trial = (levels[:, None, None] * shape).flatten(0, 1)
    reached = drive(rig, theta.repeat(len(levels), 1), times, trial).abs().amax(1).unflatten(0, (len(levels), -1))
    # Softening springs jump to a large swing: the last level before the first that goes too far.
    gentle = torch.cumprod((reached <= swing).long(), 0).sum(0).clamp(min=1) - 1
    # Four digits, as an operator would type them.
    return torch.round(levels[gentle, None] * shape, decimals=4)


def _swings(runs: int, bounds: tuple[float, float], seed: int) -> Tensor:
    low, high = bounds
    return low + (high - low) * torch.rand(runs, generator=generator(seed, "swing"), dtype=torch.float64)


def _hidden(truth: Mapping[str, float]) -> str | None:
    present = [key for key, name, _, _ in SIZES.values() if truth[name] > 0]
    return "+".join(present) or None
