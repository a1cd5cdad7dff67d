"""The inputs of an effect in every world, at its target: motion, drive, command, a servo's law, a sensor's signal."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor


@dataclass(frozen=True)
class Servo:
    """The actuator of a joint: f(q, v) = clip(force - stiffness (q' - q) - damping (v' - v)) at q', v'.

    f is on the joint; for an effect at the actuator it is the actuator's own, before the gear. q and v are the joint's.

    As in :class:`Seen`, (N,) stands for (N, K) of K rows at once.

    Args:
        force: at the joint's present position and velocity, before the limits (N,) [N, N m].
        stiffness: kp; 0 of a motor (N,) [N/m, N m/rad].
        damping: kv; 0 of a motor (N,) [N s/m, N m s/rad].
        low, high: its limits (N,) [N, N m]; both 0 while it is off.
    """

    force: Float[Tensor, "*batch"]
    stiffness: Float[Tensor, "*batch"]
    damping: Float[Tensor, "*batch"]
    low: Float[Tensor, "*batch"]
    high: Float[Tensor, "*batch"]

    def row(self, k: int) -> Servo:
        """Row k of K at once."""
        return Servo(*(getattr(self, field.name)[:, k] for field in fields(self)))


@dataclass(frozen=True)
class Seen:
    """The inputs of an effect at its target in every world at the start of an integration step; (N, K) for K rows.

    Args:
        q: position of the joint; of an actuator, of the joint that it drives (N,) [m, rad].
        v: its velocity (N,) [m/s, rad/s].
        drive: f, generalised force of the joint's actuators, with what effects at them add (N,) [N, N m]; for an effect
            at an actuator, its own force in the model before the gear [N, N m at its transmission]. Limits and
            switched-off actuators are in it. On MuJoCo zero unless the effect says that it ``needs_drive``. Where
            hidden states are recalled along a known motion, effects at actuators are not in it.
        command: u, the command after the input stages, summed over a joint's actuators (N,) [command units].
        hidden: the effect's own hidden state, see :meth:`Effect.rest`.
        timestep: length h of the step [s].
        servo: the law of the joint's actuator, for an effect that says it ``needs_servo``.
        memo: what the effect has worked out of this already; empty at first.
    """

    q: Float[Tensor, "*batch"]
    v: Float[Tensor, "*batch"]
    drive: Float[Tensor, "*batch"]
    command: Float[Tensor, "*batch"]
    hidden: TensorDict | None
    timestep: float
    servo: Servo | None = None
    memo: dict[str, object] = field(default_factory=dict, compare=False, repr=False)

    def row(self, k: int, hidden: TensorDict | None) -> Seen:
        """Row k of K at once, with the hidden state before it."""
        servo = None if self.servo is None else self.servo.row(k)
        return Seen(self.q[:, k], self.v[:, k], self.drive[:, k], self.command[:, k], hidden, self.timestep, servo)


@dataclass(frozen=True)
class Reading:
    """One signal of a trajectory as a perfect sensor gives it.

    Args:
        value: at the instants (*batch, T) [SI].
        start: at the trajectory's start (*batch,) [SI].
        slope: its rate of change there, where the state tells it (positions: the velocity), else 0 (*batch,).
        times: instants since the start (T,) [s].
    """

    value: Float[Tensor, "*batch T"]
    start: Float[Tensor, "*batch"]
    slope: Float[Tensor, "*batch"]
    times: Float[Tensor, " T"]

    def at(self, then: Float[Tensor, "*batch T"]) -> Float[Tensor, "*batch T"]:
        """The signal at other instants [SI].

        Between those of the reading linearly, before the start along the start's slope, after the end as before it.

        Args:
            then: since the start [s].
        """
        line = torch.cat([self.start[..., None], self.value], dim=-1)
        knots = torch.cat([self.times.new_zeros(1), self.times])
        after = torch.searchsorted(knots, then.contiguous()).clamp(1, len(self.times))
        before, at = line.gather(-1, after - 1), line.gather(-1, after)
        part = (then - knots[after - 1]) / (knots[after] - knots[after - 1])
        earlier = self.start[..., None] + self.slope[..., None] * then
        return torch.where(then < 0, earlier, before + part * (at - before))


def limited(
    force: Float[Tensor, "*batch"], low: Float[Tensor, "*batch"], high: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """The force within its limits [N, N m]."""
    return torch.minimum(torch.maximum(force, low), high)
