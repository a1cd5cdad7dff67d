"""A rig: its equations, the engineer's model of it, its inputs and sensors, the effects that may hide in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.drive import Actuator, Drive
from envs.rigs.equations import Equations, Values
from envs.rigs.integrator import HiddenMass, Hysteresis, Plant
from envs.rigs.laws import JointLaws
from envs.rigs.off_numbers import OffNumber

MODELS = Path(__file__).with_name("models")


@final
@dataclass(frozen=True)
class HiddenEffect:
    """Something that may be hidden in a rig.

    Args:
        key: ``effect@target``; the contract's names, or one outside the vocabulary.
        size: parameters that grow with the size of the effect, at medium size [SI].
        shape: parameters that do not.
        shrinks: for limits, whose value falls as the effect grows (slowly: all happens near the greatest force).
        neutral: what the sizes are added to, for effects that replace a value of the model.
    """

    key: str
    size: Mapping[str, float]
    shape: Mapping[str, float] = field(default_factory=dict)
    shrinks: bool = False
    neutral: float = 0.0

    def values(self, scale: float, sign: float = 1.0) -> dict[str, float]:
        """Addresses -> values at ``scale`` times the medium size; ``sign`` turns those that may be negative."""
        turn = sign if self.key.split("@")[0] in SIGNED else 1.0
        sized = {name: self.neutral + turn * self.factor(scale) * value for name, value in self.size.items()}
        return {f"{self.key}.{name}": value for name, value in {**self.shape, **sized}.items()}

    def factor(self, scale: float) -> float:
        """By what the parameters of medium size are multiplied at that scale."""
        return scale**-0.3 if self.shrinks else scale

    def resized(self, scale: float) -> HiddenEffect:
        """The same effect with another medium size: ``scale`` times this one."""
        return replace(self, size={name: self.factor(scale) * value for name, value in self.size.items()})


# Effects whose size may have either sign.
SIGNED = ("constant_load", "actuator_gain", "sensor_bias", "sensor_scale", "com_offset", "gravity_tilt")


@final
@dataclass(frozen=True)
class Protocol:
    """Protocol by which a rig is driven and read.

    Args:
        step: h of the integrator [s].
        period: from one row to the next, in steps.
        jitter: by how many steps a row may come early or late.
        fit, held: numbers of runs to fit and to hold out.
        seconds: length of a run [s].
        resolution: of the encoders, per joint [m, rad].
        sd: of their white noise before rounding, per joint [m, rad].
        speed_sd: noise of measured velocities, per joint; empty when positions alone are read.
        amplitude: of the commands, per actuator, or of the goals under feedback [command units; m, rad].
        feedback: gains (kp, kd) per actuator, or empty: the commands are the inputs themselves.
        band: lowest and highest frequency of the inputs [Hz].
        start: half-width of the speeds that runs start with, per joint; empty: from rest.
    """

    step: float
    period: int
    jitter: int
    fit: int
    held: int
    seconds: float
    resolution: tuple[float, ...]
    sd: tuple[float, ...]
    speed_sd: tuple[float, ...]
    amplitude: tuple[float, ...]
    feedback: tuple[tuple[float, float], ...] = ()
    band: tuple[float, float] = (0.2, 3.0)
    start: tuple[float, ...] = ()

    @property
    def floor(self) -> Float[ndarray, " n"]:
        """Standard deviation of one position reading, rounding included [m, rad]."""
        return np.hypot(self.sd, np.array(self.resolution) / np.sqrt(12))


@final
@dataclass(frozen=True)
class Tie:
    """Two effects that the inputs of a rig cannot part.

    Args:
        hidden: the one that is there.
        partner: the one that looks alike.
        fixed: parameters that must not be free, for they would look alike too.
    """

    hidden: HiddenEffect
    partner: str
    fixed: tuple[str, ...] = ()


@final
@dataclass(frozen=True)
class Rig:
    """A rig.

    Args:
        name: also of its model file.
        joints: names, in the model's order.
        actuators: of the model, in its order.
        nominal: every base parameter of the model file [SI], by address.
        free: addresses -> bounds that the engineer gives [SI].
        equations: values -> equations of motion.
        protocol: how it is recorded.
        effects: what may hide in it.
        last: what may hide in it and criticism tries last, where nothing else explains the log.
        by_name: what may hide in it and criticism tries where it is named only; no case of a blind study hides it.
        outside: what may hide in it and no vocabulary names. A mode lies in the band of the inputs: one far above it is
            a mass.
        ties: pairs of effects that the cases of kind ``tie`` are made with.
        alike: groups of effects that no input parts on this rig while ``free`` is free: the right name of one of them
            is the name of any.
        surplus: passive terms that an engineer may put into the model and the machine lacks.
        own: numbers of the model that may be off.
        moments: principal moments of its model that are the armature of a hinge: number -> effect.
    """

    name: str
    joints: tuple[str, ...]
    actuators: tuple[Actuator, ...]
    nominal: Mapping[str, float]
    free: Mapping[str, tuple[float, float]]
    equations: Callable[[Values], Equations]
    protocol: Protocol
    effects: tuple[HiddenEffect, ...]
    outside: tuple[HiddenEffect, ...]
    ties: tuple[Tie, ...]
    alike: tuple[tuple[str, ...], ...] = ()
    last: tuple[HiddenEffect, ...] = ()
    by_name: tuple[HiddenEffect, ...] = ()
    surplus: tuple[OffNumber, ...] = ()
    own: tuple[OffNumber, ...] = ()
    moments: Mapping[str, str] = field(default_factory=dict)

    @property
    def xml(self) -> str:
        """The engineer's model."""
        return (MODELS / f"{self.name}.xml").read_text(encoding="utf-8")

    @property
    def laws(self) -> dict[str, str]:
        """Numbers of the model -> the effect that is the same law."""
        return {**self.moments, **{off.key: off.law for off in (*self.surplus, *self.own)}}

    def partners(self, keys: tuple[str, ...]) -> tuple[str, ...]:
        """Effects that look like one of these; an effect of a group may be meant along an axis of its own."""
        groups = [g for g in self.alike if any(key == one or key.startswith(f"{one}.") for key in keys for one in g)]
        return tuple(key for group in groups for key in group if key not in keys)

    def plant(
        self, values: Values, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"], step: float | None = None
    ) -> Plant:
        """The rig with these values, at rest or moving.

        Args:
            values: addresses -> values [SI]; base parameters that are missing are nominal.
            q, v: states of R runs at the start.
            step: h [s]; the protocol's when not given.
        """
        values = {**self.nominal, **values}
        equations = self.equations(values)
        laws = JointLaws(self.joints, values, equations.sliding_friction(len(self.joints))).compiled()
        drive = Drive(self.actuators, values, len(q), len(self.joints), step or self.protocol.step)
        return Plant(equations, laws, drive, q, v, self._behind(values), self._memory(values))

    def _behind(self, values: Values) -> HiddenMass | None:
        for actuator in self.actuators:
            if (key := f"backlash@{self.joints[actuator.joint]}") + ".gap" in values:
                # A stiff gear, whose frequency stays a fifth of what the integrator bears; oiled, it hardly rebounds.
                rotor = values[f"{key}.rotor"]
                stiffness = rotor * (0.5 / self.protocol.step) ** 2
                damping = 1.4 * (stiffness * rotor) ** 0.5
                return HiddenMass(actuator.joint, rotor, stiffness, damping, values[f"{key}.gap"], driven=True)
        for joint, name in enumerate(self.joints):
            if (key := f"flexible_mode@{name}") + ".mass" in values:
                pulse = 2 * np.pi * values[f"{key}.frequency"]
                m = values[f"{key}.mass"]
                return HiddenMass(joint, m, m * pulse**2, 0.04 * m * pulse, 0.0, driven=False)
        return None

    def _memory(self, values: Values) -> Hysteresis | None:
        for joint, name in enumerate(self.joints):
            if (key := f"hysteresis@{name}") + ".amplitude" in values:
                return Hysteresis(joint, values[f"{key}.amplitude"], values[f"{key}.width"])
        return None
