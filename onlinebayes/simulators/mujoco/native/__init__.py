"""Effects that MuJoCo has itself: the term that carries each, and the table of them."""

from typing import Any

from onlinebayes.simulators import effects
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.mujoco.native.actuators import ForceRange, Gain, VelocityBias
from onlinebayes.simulators.mujoco.native.air import FIELDS, Drag
from onlinebayes.simulators.mujoco.native.bodies import CentreOfMass, Gravity, PointMass
from onlinebayes.simulators.mujoco.native.contacts import SlidingFriction, Softness
from onlinebayes.simulators.mujoco.native.frictions import Friction, FrictionOfTwoSizes
from onlinebayes.simulators.mujoco.native.joints import CubicSpring, JointField, Load, Spring
from onlinebayes.simulators.mujoco.native.term import NativeTerm

NATIVE: dict[type[Effect], NativeTerm[Any]] = {
    effects.ViscousFriction: JointField(("dof_damping",)),
    effects.QuadraticDrag: JointField(("dof_dampingpoly",), (0,)),
    effects.Armature: JointField(("dof_armature",)),
    effects.JointStiffness: Spring(),
    effects.CubicStiffness: CubicSpring(),
    effects.ConstantLoad: Load(),
    effects.DryFriction: Friction(),
    effects.AsymmetricFriction: FrictionOfTwoSizes(),
    effects.Payload: PointMass(),
    effects.ComOffset: CentreOfMass(),
    effects.GravityTilt: Gravity(),
    effects.AirDrag: Drag(),
    effects.Wind: Drag((*FIELDS, "opt.wind")),
    effects.ActuatorGain: Gain(),
    effects.ActuatorSaturation: ForceRange(),
    effects.BackEmf: VelocityBias(),
    effects.ContactFriction: SlidingFriction(),
    effects.ContactSoftness: Softness(),
}
"""Kind of effect -> MuJoCo's term for it; a module of one's own adds to it. All others are input and force stages."""


def native(effect: Effect) -> NativeTerm[Any] | None:
    """The term of an effect's kind, or of the nearest kind that it is made from; None where MuJoCo has none."""
    return next((NATIVE[kind] for kind in type(effect).__mro__ if kind in NATIVE), None)


__all__ = ["NATIVE", "JointField", "NativeTerm", "native"]
