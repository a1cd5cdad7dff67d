"""From a command to the force at a joint: delay, lag, dead zone, gain, back-EMF, limit, heat.

    u -> u(t - T) -> first-order lag -> dead zone -> (1 + g + d sign u) u
      -> motor: u - k v, servo: kp (u - q) - kv v - k v
      -> clipped to the limit -> / (1 + c h),   T_h dh/dt = (f / f_ref)^2 - h -> gear

The velocity at a motor is that of its joint times the gear. Commands are piecewise constant; a step uses their mean
over the step, so that a delay need not be a whole number of steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.equations import Values


@final
@dataclass(frozen=True)
class Actuator:
    """One actuator on one joint.

    Args:
        name: in the model.
        joint: index of its joint.
        reference: f_ref, the force that heats it [N, N m].
        servo: does its command mean a position?
    """

    name: str
    joint: int
    reference: float
    servo: bool = False


@final
class Drive:
    """All actuators of a rig, with their hidden states for R runs.

    Args:
        actuators: m of them, at most one a joint.
        values: addresses -> values [SI]; ``actuator.x.gear[0]``, ``.kp``, ``.kv``, ``.forcerange[1]`` and effects.
        runs: R.
        joints: n.
        step: h [s].
    """

    def __init__(self, actuators: tuple[Actuator, ...], values: Values, runs: int, joints: int, step: float) -> None:
        def at(pattern: str, default: float = 0.0) -> Float[ndarray, " m"]:
            return np.array([values.get(pattern.format(actuator.name), default) for actuator in actuators])

        self.step, self.joints = step, joints
        self.index = [actuator.joint for actuator in actuators]
        self.servo = np.array([actuator.servo for actuator in actuators])
        self.reference = np.array([actuator.reference for actuator in actuators])
        self.gear = at("actuator.{}.gear[0]", 1.0)
        self.kp, self.kv = at("actuator.{}.kp"), at("actuator.{}.kv")
        self.gain, self.emf = at("actuator_gain@{}.gain"), at("back_emf@{}.constant")
        self.direction = at("direction_gain@{}.gain")
        self.limit = np.minimum(at("actuator.{}.forcerange[1]", math.inf), at("actuator_saturation@{}.limit", math.inf))
        self.dead = at("actuator_dead_zone@{}.width")
        self.lag, self.delay = at("actuator_lag@{}.time_constant"), at("actuator_delay@{}.delay")
        self.derating, self.warming = (
            at("thermal_derating@{}.coefficient"),
            at("thermal_derating@{}.time_constant", 1.0),
        )
        self._past = np.zeros((math.ceil(self.delay.max(initial=0.0) / step) + 2, runs, len(actuators)))
        self._lagged = np.zeros((runs, len(actuators)))
        self._heat = np.zeros((runs, len(actuators)))
        self._filled = False
        self.on = True
        """Off, the actuators give no force, whatever the command; a servo does not hold its goal either."""

    def shaped(self, command: Float[ndarray, "R m"]) -> Float[ndarray, "R m"]:
        """Return the mean command at the actuators over the next step; the first command held before the log."""
        if not self._filled:
            self._past[:], self._lagged[:], self._filled = command, command, True
        self._past = np.concatenate([command[None], self._past[:-1]])
        whole = np.floor(self.delay / self.step + 1e-9)
        late = self.delay / self.step - whole
        slot, m = whole.astype(int), np.arange(command.shape[1])
        u = (1 - late) * self._past[slot, :, m].T + late * self._past[slot + 1, :, m].T
        if self.lag.any():
            decay = np.where(self.lag > 0, np.exp(-self.step / np.maximum(self.lag, 1e-12)), 0.0)
            mean = u + (self._lagged - u) * self.lag / self.step * (1 - decay)
            self._lagged = u + (self._lagged - u) * decay
            u = mean
        u = np.sign(u) * np.maximum(np.abs(u) - self.dead, 0.0) if self.dead.any() else u
        return (1 + self.gain + self.direction * np.sign(u)) * u

    def force(
        self, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"], u: Float[ndarray, "R m"]
    ) -> Float[ndarray, "R n"]:
        """Forces at the joints [N, N m] under a shaped command."""
        speed = v[:, self.index] * self.gear
        f = np.where(self.servo, self.kp * (u - q[:, self.index] * self.gear) - self.kv * speed, u)
        f = np.clip(f - self.emf * speed, -self.limit, self.limit) / (1 + self.derating * self._heat)
        joint = np.zeros((len(q), self.joints))
        joint[:, self.index] = f * self.gear if self.on else 0.0
        return joint

    def warm(self, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"], u: Float[ndarray, "R m"]) -> None:
        """Heat of one step that ended here."""
        if self.derating.any():
            load = (self.force(q, v, u)[:, self.index] / self.gear / self.reference) ** 2
            self._heat = load + (self._heat - load) * np.exp(-self.step / self.warming)
