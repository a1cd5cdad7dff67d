"""By which signal the motion of each joint is seen: its position, or its velocity where no position was measured.

    position measured     q(t),  v = dq/dt
    velocity alone        v(t),  q = int v dt from the run's first row, where q is 0

A car has a tachometer and no ruler. Where its joint begins is then known to nobody and needed by nothing: a position
that is not measured is refused where the model's motion depends on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

SHIFT = 0.37  # [m, rad], no part of a turn
ALIKE = 1e-9  # of the velocities' size
INSIDE = 0.37  # of the unit cube
FEWEST_ROWS = 3  # of a run that shows an acceleration


@dataclass(frozen=True)
class SeenBy:
    """The signal that shows a joint's motion.

    Args:
        joint: its name.
        column: place of the signal among those measured.
        position: whether it is the joint's position; else its velocity.
    """

    joint: str
    column: int
    position: bool

    @property
    def signal(self) -> str:
        """``qpos.<joint>`` or ``qvel.<joint>``."""
        return f"{'qpos' if self.position else 'qvel'}.{self.joint}"

    def velocity(self, values: Float[Tensor, "*batch n S"], step: float) -> Float[Tensor, "*batch n"]:
        """The joint's velocity at rows of spacing ``step`` [s]; differences where its position was measured."""
        seen = values[..., self.column]
        if not self.position:
            return seen
        return torch.gradient(seen, spacing=step, dim=-1)[0] if seen.shape[-1] > 1 else torch.zeros_like(seen)

    def speed_unit(self, units: Mapping[str, str]) -> str:
        """Unit of the velocity, from those of the signals; empty where that is not known."""
        unit = units.get(self.signal) or ""
        return f"{unit}/s" if self.position and unit else unit


def seen_by(joint: str, names: Sequence[str]) -> SeenBy:
    """By which of the measured signals the joint's motion is seen, its position first.

    Raises:
        BadInput: neither was measured.
    """
    for position in (True, False):
        name = f"{'qpos' if position else 'qvel'}.{joint}"
        if name in names:
            return SeenBy(joint, list(names).index(name), position)
    raise BadInput(
        f"joint '{joint}' has no measured position or velocity",
        f"add the column qpos.{joint}, or qvel.{joint} where nothing depends on the position, or weld the joint",
    )


def check_seen(simulator: Identifiable, joints: Sequence[str], names: Sequence[str]) -> None:
    """Every joint of the simulator is seen, and what is seen by its velocity alone moves alike wherever it is.

    Args:
        simulator: with its effects.
        joints: its joints, in its order.
        names: of the measured signals.

    Raises:
        BadInput: a joint that is not measured, or a position that is missed.
    """
    missing = [j for j, joint in enumerate(joints) if not seen_by(joint, names).position]
    if not missing:
        return
    theta = _somewhere(simulator)
    base = _after_a_step(simulator, theta, None)
    for j in missing:
        change = (_after_a_step(simulator, theta, j) - base).abs().max()
        if not bool(change <= ALIKE * base.abs().max().clamp_min(1.0)):
            raise BadInput(
                f"joint '{joints[j]}' has no measured position, and the motion depends on it",
                f"add the column qpos.{joints[j]}; its velocity does alone where only differences of position matter",
            )


def check_runs(joints: Sequence[str], measurement: Measurement) -> None:
    """Every run has a value of the signal by which each joint is seen, and one has rows enough to show a motion.

    A joint without a value would rest at 0.

    Args:
        joints: the simulator's, in its order.
        measurement: the runs.

    Raises:
        BadInput: a joint that no signal shows, or not in one of the runs; runs of fewer than three rows.
    """
    if int(measurement.lengths.max()) < FEWEST_ROWS:
        raise BadInput(f"no run has more than {FEWEST_ROWS - 1} rows", "record runs of many rows; a run is one motion")
    names = [signal.name for signal in measurement.signals]
    shown = [seen_by(joint, names) for joint in joints]
    measured = measurement.data["measured"].any(1)
    for run, seen in zip(measurement.runs, measured, strict=True):
        for one in shown:
            if not bool(seen[one.column]):
                raise BadInput(
                    f"joint '{one.joint}' has no measured {'position' if one.position else 'velocity'}: "
                    f"no cell of {one.signal} has a value in this run",
                    f"fill them, leave the run out (exclude), or weld the joint{_or_speed(one, names, seen)}",
                    where=f"run '{run}'",
                )


def _or_speed(position: SeenBy, names: Sequence[str], seen: Bool[Tensor, " S"]) -> str:
    """The way out where the run has the joint's velocity."""
    rate = f"qvel.{position.joint}"
    if not position.position or rate not in names or not bool(seen[list(names).index(rate)]):
        return ""
    return f"; {rate} does alone where nothing depends on the position: ignore the column {position.signal} then"


def _somewhere(simulator: Simulator) -> Float[Tensor, "2 P"]:
    """The nominal theta, and one inside the bounds: a parameter may be nothing in the model as it was built."""
    nominal = simulator.nominal
    inside = simulator.parameters.from_unit(torch.full_like(nominal, INSIDE))
    return torch.stack([nominal, inside])


def _after_a_step(simulator: Identifiable, theta: Float[Tensor, "M P"], moved: int | None) -> Float[Tensor, "M J"]:
    """Velocities a timestep after all joints moved at 1, one of them displaced [m/s, rad/s]."""
    q = simulator.state["qpos"][:1].repeat(len(theta), 1)
    if moved is not None:
        q[:, moved] += SHIFT
    state = TensorDict({"qpos": q, "qvel": torch.ones_like(q)}, batch_size=(len(theta),))
    command = q.new_ones(len(theta), 1, len(simulator.commands))
    inputs = TensorDict({"command": command}, batch_size=(len(theta), 1))
    return simulator.rollout(theta, state, inputs, theta.new_tensor([simulator.timestep]))["qvel"][:, 0]
