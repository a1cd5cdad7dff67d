"""Free play between an actuator and the joint that it drives.

    the motor's side m, of inertia R, stays within half the gap of the joint:    abs(m - q) <= g/2
    at a stop both move as one:     M a = f(m, v) + tau       (R is a part of the joint's inertia M in the model)
    in between each for itself:     R dw/dt = f(m, w),   (M - R) a = tau
    where they meet, plastically:   the joint is struck by R (w - v)
    they part where the stop would have to pull:   side (f - R a) < 0

f is the actuator's force with its limits (a motor's does not depend on m and w = dm/dt, a position servo's does), tau
all others. The hidden state is m - q, w, and what is needed to see a stop let go (Nordin and Gutman 2002 survey such
models). Positions of the joint are the load's.

Timestep h: the motor's step is implicit in w (a servo may be stiff for a light rotor); a blow at the part phi of a step
gives 1 - phi of its momentum in that step and the rest in the next, so that the joint is where it would be; the
acceleration that tells of a pull is the last step's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, cast

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects.base import Effect
from onlinebayes.simulators.effects.bounds import joint_unit, non_negative
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen, Servo, limited
from onlinebayes.simulators.standalone.play import Play

REMEMBERED = 1.0
"""The time for which the side on which the gap was closed last may matter [s]."""
UNKNOWN, APART, TOUCHING, STRUCK = -1.0, 0.0, 1.0, 2.0
"""The hidden state ``"contact"``: not begun, in the gap, at a stop, at a stop that was just reached."""
STATE = ("offset", "speed", "before", "contact", "owed")


@dataclass(frozen=True)
class Backlash(Effect):
    """Play of full width g between an actuator, whose side has the inertia R, and its joint.

    Hidden state :data:`STATE`, each (N,): m - q (in the gap without the joint's own way in the last step), the speed of
    the motor's side, the joint's at the last step's start, the contact, and what the last blow has still to give.

    Args:
        target: joint with one actuator.
        gap: bounds of g >= 0 [m, rad].
        rotor: bounds of R > 0, less than what the joint moves [kg, kg m2].
    """

    target: str
    gap: Parameter
    rotor: Parameter
    name = "backlash"
    target_kind = "joint"
    needs_drive = True
    needs_servo = True
    tried_at_servos = True  # behind a motor its refits take minutes

    def __post_init__(self) -> None:
        non_negative(self.key, "gap", self.gap)
        if self.rotor.low <= 0:
            problem = f"{self.key}.rotor may be {self.rotor.low:g} {self.rotor.unit}"
            raise BadInput(problem, "a motor without inertia crosses its play at once: take a lower bound above 0")

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """g up to a fifth of the travel, R from a hundredth to two thirds of what the joint moves."""
        gap, mass = joint_unit(scales.unit, "m", "rad"), joint_unit(scales.unit, "kg", "kg m2")
        rotor = Parameter(0.01 * scales.inertia, 0.67 * scales.inertia, mass)
        return cls(target, Parameter(0.0, 0.2 * scales.travel, gap), rotor)

    @property
    def parameters(self) -> ParameterSpace:
        """``gap``, ``rotor``."""
        return ParameterSpace({"gap": self.gap, "rotor": self.rotor})

    @property
    def neutral(self) -> Mapping[str, float]:
        """g = 0, for whatever R."""
        return {"gap": 0.0, "rotor": self._some(0.3)}

    def standalone(self, values: Mapping[str, float]) -> Play:
        """See :class:`.Play`."""
        return Play(values["gap"], values["rotor"])

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Four gaps from narrow to wide: the replay is far from linear in the gap, and one does not predict another."""
        width = self.gap.high - self.gap.low
        return tuple({**self.neutral, "gap": self.gap.low + part * width} for part in (0.01, 0.05, 0.2, 0.6))

    def _some(self, part: float) -> float:
        return self.rotor.low + part * (self.rotor.high - self.rotor.low)

    @property
    def memory(self) -> float:
        """Until a motor that moves has closed its gap again [s]."""
        return REMEMBERED

    def rest(self, worlds: int, timestep: float, like: Tensor) -> TensorDict:
        """The motor in the middle of its play, as fast as the joint."""
        zero = torch.zeros(worlds, dtype=like.dtype, device=like.device)
        state = {key: zero + UNKNOWN if key == "contact" else zero.clone() for key in STATE}
        return TensorDict(state, batch_size=[worlds], device=like.device)

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """Return the force on the joint besides the actuator's force in the model [N, N m]; 0 for g = 0.

        In the gap nothing but the loss of it; at a stop the force as it is on the motor's side, and the blow.
        """
        now = self._now(parameters, seen)
        felt = torch.where(now.apart, torch.zeros_like(now.push), now.push + now.blow / seen.timestep) - seen.drive
        return torch.where(parameters["gap"] > 0, felt, torch.zeros_like(felt))

    def inertia(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """-R in the gap, where the joint moves without the motor [kg, kg m2]; 0 for g = 0."""
        now, rotor = self._now(parameters, seen), parameters["rotor"]
        return torch.where((parameters["gap"] > 0) & now.apart, -rotor, torch.zeros_like(rotor))

    def advance(self, parameters: Mapping[str, Tensor], seen: Seen) -> TensorDict:
        """Place and speed of the motor at the step's end; the joint's own way in the gap is not known yet."""
        now, h = self._now(parameters, seen), seen.timestep
        rotor, servo = parameters["rotor"] / h, _servo(seen)
        # R (w' - w) / h = f(m + h w', w'): the servo's force, less what the motor's own way and speed take from it.
        pull = servo.force + servo.damping * seen.v - servo.stiffness * now.offset
        resists = servo.damping + h * servo.stiffness
        force = rotor * (pull - resists * now.speed) / (rotor + resists)
        speed = torch.where(now.apart, now.speed + limited(force, servo.low, servo.high) / rotor, seen.v)
        offset = torch.where(now.apart, now.offset + 0.5 * h * (now.speed + speed), now.offset)
        kind = torch.where(now.apart, APART, torch.where(now.struck, STRUCK, TOUCHING)).to(speed)
        state = {"offset": offset, "speed": speed, "before": seen.v.clone(), "contact": kind, "owed": now.owed}
        return TensorDict(state, batch_size=speed.shape, device=speed.device)

    def _now(self, parameters: Mapping[str, Tensor], seen: Seen) -> _Now:
        """Return the motor side's state at the start of the step and its motion in the step; computed once a step."""
        if "now" not in seen.memo:
            seen.memo["now"] = self._look(parameters, seen)
        return cast(_Now, seen.memo["now"])

    def _look(self, parameters: Mapping[str, Tensor], seen: Seen) -> _Now:
        assert seen.hidden is not None
        offset, speed, before, contact, owed = (seen.hidden[key] for key in STATE)
        half, h, rotor, servo = parameters["gap"] / 2, seen.timestep, parameters["rotor"], _servo(seen)
        unknown, touched = contact == UNKNOWN, contact >= TOUCHING
        # At a stop that lets go the motor has the joint's own speed.
        speed = torch.where(unknown | touched, seen.v, speed)
        moved = torch.where(unknown | touched, 0.0, 0.5 * h * (before + seen.v))
        offset = offset - moved
        away = speed - seen.v
        side = torch.sign(torch.where(touched, offset, away))
        phi = ((half - side * offset) / (h * away.abs()).clamp_min(1e-300)).clamp_min(0.0)
        struck = ~touched & (phi <= 1)
        push = limited(servo.force - servo.stiffness * side * half, servo.low, servo.high)
        pulled = side * (push - rotor * (seen.v - before) / h) < 0
        parting = touched & pulled & (contact != STRUCK)
        blow = torch.where(struck, rotor * away, torch.zeros_like(away))
        now = phi.clamp_max(1.0)
        return _Now(
            offset=torch.where(touched | struck, side * half, offset),
            speed=speed,
            apart=parting | (~touched & ~struck),
            struck=struck,
            push=push,
            blow=(1 - now) * blow + owed,
            owed=now * blow,
        )


@dataclass(frozen=True)
class _Now:
    """The state of the motor's side during a step, and the force and the blow at its stop.

    Args:
        offset, speed: m - q and w at its start.
        apart, struck: whether it moves for itself, and whether it meets a stop.
        push: the actuator's force at that stop [N, N m].
        blow, owed: momentum of a blow that the joint gets now, and in the next step [N s, N m s].
    """

    offset: Float[Tensor, " N"]
    speed: Float[Tensor, " N"]
    apart: Bool[Tensor, " N"]
    struck: Bool[Tensor, " N"]
    push: Float[Tensor, " N"]
    blow: Float[Tensor, " N"]
    owed: Float[Tensor, " N"]


def _servo(seen: Seen) -> Servo:
    assert seen.servo is not None
    return seen.servo
