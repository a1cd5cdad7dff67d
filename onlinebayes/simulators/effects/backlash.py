"""Free play between a position servo and the joint that it drives.

    the motor's side m stays within half the gap of the joint:    |m - q| <= g/2
    at a stop, m = q +- g/2:   the joint feels f(m, dq/dt) = kp (u - m) - kv dq/dt, as long as that pushes against it
    in between:                the joint feels nothing, the motor follows its goal: kv dm/dt = kp (u - m)

f is the servo's own law with its limits, its motor's side without inertia: what that is in the model (``armature``)
stays with the joint. A motor under a force alone would need an inertia to cross the gap, so that only servos can have
play. The hidden state is m - q (Nordin and Gutman 2002 survey such models). Positions of the joint are the load's.

Of first order in the timestep h, as all force stages: over a step m relaxes by exp(-h kp / kv), the joint moves with
its present velocity, and where the two then meet, the force of the stop acts over the whole step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects.base import Effect, Scales, Seen, Servo
from onlinebayes.simulators.effects.bounds import joint_unit, non_negative

REMEMBERED = 2.0
"""How long the side on which the gap was closed last may matter [s]."""


@dataclass(frozen=True)
class Backlash(Effect):
    """Play of full width g between a servo and its joint. Hidden state ``"offset"`` (N,): m - q.

    Args:
        target: joint with one position servo and no other actuator.
        gap: bounds of g >= 0 [m, rad].
    """

    target: str
    gap: Parameter
    name = "backlash"
    target_kind = "joint"
    needs_drive = True
    needs_servo = True

    def __post_init__(self) -> None:
        non_negative(self.key, "gap", self.gap)

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """g up to a fifth of the travel."""
        return cls(target, Parameter(0.0, 0.2 * scales.travel, joint_unit(scales.unit, "m", "rad")))

    @property
    def parameters(self) -> ParameterSpace:
        """``gap``."""
        return ParameterSpace({"gap": self.gap})

    @property
    def neutral(self) -> Mapping[str, float]:
        """g = 0."""
        return {"gap": 0.0}

    @property
    def memory(self) -> float:
        """Until a servo that moves has closed its gap again [s]."""
        return REMEMBERED

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict:
        """The motor in the middle of its play."""
        offset = torch.zeros(worlds, dtype=like.dtype, device=like.device)
        return TensorDict({"offset": offset}, batch_size=[worlds], device=like.device)

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """What the joint feels in place of the servo's force, less that force; 0 for g = 0 [N, N m]."""
        half, servo = parameters["gap"] / 2, _servo(seen)
        side = self._side(half, seen)
        pushed = torch.minimum(torch.maximum(servo.force - servo.stiffness * side * half, servo.low), servo.high)
        felt = side * (side * pushed).clamp_min(0.0)  # a stop pushes, it does not pull
        return torch.where(half > 0, felt - seen.drive, torch.zeros_like(felt))

    def advance(self, parameters: Mapping[str, Tensor], seen: Seen) -> TensorDict:
        """m - q at the end of the step."""
        half = parameters["gap"] / 2
        offset = torch.minimum(torch.maximum(_freely(seen), -half), half)
        return TensorDict({"offset": offset}, batch_size=offset.shape, device=offset.device)

    @staticmethod
    def _side(half: Float[Tensor, " N"], seen: Seen) -> Float[Tensor, " N"]:
        """1 or -1 at a stop, 0 in between."""
        offset = _freely(seen)
        return torch.where(offset.abs() > half, torch.sign(offset), torch.zeros_like(offset))


def _freely(seen: Seen) -> Float[Tensor, " N"]:
    """m - q after the step if there were no stops."""
    assert seen.hidden is not None
    servo, offset = _servo(seen), seen.hidden["offset"]
    stiffness = servo.stiffness.clamp_min(1e-12)
    goal = (servo.force + servo.damping * seen.v) / stiffness  # less q: where the servo at rest gives no force
    # Without damping the motor is at its goal at once; 1e-9 of a step stands for none.
    kept = torch.exp(-seen.timestep * stiffness / servo.damping.clamp_min(1e-9 * seen.timestep * stiffness))
    followed = torch.where(servo.low < servo.high, goal + (offset - goal) * kept, offset)  # a motor that is off stays
    return followed - seen.timestep * seen.v


def _servo(seen: Seen) -> Servo:
    assert seen.servo is not None
    return seen.servo
