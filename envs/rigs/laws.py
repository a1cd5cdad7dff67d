"""Laws at the joints beside the equations of motion: resistances, springs, disturbances and dry friction.

    tau = -d v - k v |v| - k1 (q - q0) - k3 (q - q0)^3 + load + A sin(n q + phase) + what no vocabulary knows
    F   = Fc + (Fs - Fc) exp(-(v/vs)^2) + F(sign) + mu |f|            bound of the dry friction, f the actuator's force

Outside every vocabulary: a detent that fades with speed, A sin(n q) / (1 + (v/v0)^2), and a disturbance in time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.equations import Values


@final
@dataclass(frozen=True)
class JointLaws:
    """The laws of n joints.

    Args:
        joints: their names.
        values: addresses -> values [SI]; what is missing is zero.
        contact: Coulomb friction that contacts add [N].
    """

    joints: tuple[str, ...]
    values: Values
    contact: Float[ndarray, " n"]

    def _at(self, pattern: str, default: float = 0.0) -> Float[ndarray, " n"]:
        return np.array([self.values.get(pattern.format(joint), default) for joint in self.joints])

    def compiled(self) -> CompiledLaws:
        """The laws with every value looked up."""
        base = self._at("joint.{}.frictionloss") + self._at("dry_friction@{}.frictionloss") + self.contact
        coulomb = base + self._at("stribeck_friction@{}.coulomb")
        return CompiledLaws(
            damping=self._at("joint.{}.damping") + self._at("viscous_friction@{}.damping"),
            rate=self._at("parameter_drift@joint.{}.damping.rate"),
            size=self._at("parameter_step@joint.{}.damping.size"),
            when=self._at("parameter_step@joint.{}.damping.time"),
            drag=self._at("quadratic_drag@{}.drag"),
            stiffness=self._at("joint_stiffness@{}.stiffness"),
            springref=self._at("joint_stiffness@{}.springref"),
            stiffness3=self._at("cubic_stiffness@{}.stiffness3"),
            springref3=self._at("cubic_stiffness@{}.springref"),
            load=self._at("constant_load@{}.load"),
            cogging=(self._at("cogging@{}.amplitude"), self._at("cogging@{}.poles"), self._at("cogging@{}.phase")),
            detent=(self._at("detent@{}.amplitude"), self._at("detent@{}.poles"), self._at("detent@{}.speed", 1.0)),
            hum=(self._at("periodic@{}.amplitude"), self._at("periodic@{}.frequency"), self._at("periodic@{}.phase")),
            coulomb=coulomb,
            breakaway=self._at("stribeck_friction@{}.static") - self._at("stribeck_friction@{}.coulomb"),
            stribeck_velocity=self._at("stribeck_friction@{}.stribeck_velocity", 1.0),
            positive=self._at("asymmetric_friction@{}.frictionloss_positive"),
            negative=self._at("asymmetric_friction@{}.frictionloss_negative"),
            mu=self._at("load_dependent_friction@{}.mu"),
            armature=self._at("joint.{}.armature") + self._at("armature@{}.armature"),
        )


@final
@dataclass(frozen=True)
class CompiledLaws:
    """Arrays (n,), one value a joint; see :class:`JointLaws` and the module's equations."""

    damping: ndarray
    rate: ndarray
    size: ndarray
    when: ndarray
    drag: ndarray
    stiffness: ndarray
    springref: ndarray
    stiffness3: ndarray
    springref3: ndarray
    load: ndarray
    cogging: tuple[ndarray, ndarray, ndarray]
    detent: tuple[ndarray, ndarray, ndarray]
    hum: tuple[ndarray, ndarray, ndarray]
    coulomb: ndarray
    breakaway: ndarray
    stribeck_velocity: ndarray
    positive: ndarray
    negative: ndarray
    mu: ndarray
    armature: ndarray

    def smooth(self, q: Float[ndarray, "R n"], v: Float[ndarray, "R n"], t: float) -> Float[ndarray, "R n"]:
        """tau at time t [N, N m]."""
        damping = self.damping + self.rate * t + self.size * (t >= self.when)
        tau = self.load - (damping + self.drag * np.abs(v)) * v - self.stiffness * (q - self.springref)
        if self.stiffness3.any():
            tau = tau - self.stiffness3 * (q - self.springref3) ** 3
        if (amplitude := self.cogging[0]).any():
            tau = tau + amplitude * np.sin(self.cogging[1] * q + self.cogging[2])
        if (amplitude := self.detent[0]).any():
            tau = tau + amplitude * np.sin(self.detent[1] * q) / (1 + (v / self.detent[2]) ** 2)
        if (amplitude := self.hum[0]).any():
            tau = tau + amplitude * np.sin(2 * np.pi * self.hum[1] * t + self.hum[2])
        return tau

    @property
    def rubs(self) -> bool:
        """Is there any dry friction?"""
        return any(part.any() for part in (self.coulomb, self.breakaway, self.positive, self.negative, self.mu))

    def bound(
        self, sign: Float[ndarray, "R n"], v: Float[ndarray, "R n"], f: Float[ndarray, "R n"]
    ) -> Float[ndarray, "R n"]:
        """F when the joint moves, or is about to, in direction ``sign`` [N, N m]."""
        static = self.breakaway * np.exp(-((v / self.stribeck_velocity) ** 2))
        return self.coulomb + static + np.where(sign > 0, self.positive, self.negative) + self.mu * np.abs(f)
