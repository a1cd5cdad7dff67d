"""The vocabulary of physical effects: named terms with bounded parameters, added with ``simulator.with_effect``."""

from onlinebayes.simulators.effects.actuator_delay import ActuatorDelay
from onlinebayes.simulators.effects.actuator_gain import ActuatorGain
from onlinebayes.simulators.effects.base import Effect, Scales
from onlinebayes.simulators.effects.constant_load import ConstantLoad
from onlinebayes.simulators.effects.dry_friction import DryFriction
from onlinebayes.simulators.effects.joint_stiffness import JointStiffness
from onlinebayes.simulators.effects.quadratic_drag import QuadraticDrag
from onlinebayes.simulators.effects.viscous_friction import ViscousFriction

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        ViscousFriction,
        DryFriction,
        QuadraticDrag,
        JointStiffness,
        ConstantLoad,
        ActuatorGain,
        ActuatorDelay,
    )
}
"""Every known effect by the contract's name; a module of one's own adds to it."""

__all__ = [
    "EFFECTS",
    "ActuatorDelay",
    "ActuatorGain",
    "ConstantLoad",
    "DryFriction",
    "Effect",
    "JointStiffness",
    "QuadraticDrag",
    "Scales",
    "ViscousFriction",
]
