"""The vocabulary of physical effects: named terms with bounded parameters, added with ``simulator.with_effect``."""

from onlinebayes.simulators.effects.actuator_delay import ActuatorDelay
from onlinebayes.simulators.effects.actuator_gain import ActuatorGain
from onlinebayes.simulators.effects.base import Effect, Reading, Scales, Seen
from onlinebayes.simulators.effects.cogging import Cogging
from onlinebayes.simulators.effects.constant_load import ConstantLoad
from onlinebayes.simulators.effects.dry_friction import DryFriction
from onlinebayes.simulators.effects.joint_stiffness import JointStiffness
from onlinebayes.simulators.effects.load_dependent_friction import LoadDependentFriction
from onlinebayes.simulators.effects.quadratic_drag import QuadraticDrag
from onlinebayes.simulators.effects.sensor_bias import SensorBias
from onlinebayes.simulators.effects.sensor_delay import SensorDelay
from onlinebayes.simulators.effects.sensor_scale import SensorScale
from onlinebayes.simulators.effects.stribeck_friction import StribeckFriction
from onlinebayes.simulators.effects.thermal_derating import ThermalDerating
from onlinebayes.simulators.effects.viscous_friction import ViscousFriction

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        ViscousFriction,
        DryFriction,
        StribeckFriction,
        LoadDependentFriction,
        QuadraticDrag,
        JointStiffness,
        ConstantLoad,
        Cogging,
        ActuatorGain,
        ActuatorDelay,
        ThermalDerating,
        SensorBias,
        SensorScale,
        SensorDelay,
    )
}
"""Every known effect by the contract's name; a module of one's own adds to it."""

__all__ = [
    "EFFECTS",
    "ActuatorDelay",
    "ActuatorGain",
    "Cogging",
    "ConstantLoad",
    "DryFriction",
    "Effect",
    "JointStiffness",
    "LoadDependentFriction",
    "QuadraticDrag",
    "Reading",
    "Scales",
    "Seen",
    "SensorBias",
    "SensorDelay",
    "SensorScale",
    "StribeckFriction",
    "ThermalDerating",
    "ViscousFriction",
]
