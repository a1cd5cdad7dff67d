"""The vocabulary of physical effects: named terms with bounded parameters, added with ``simulator.with_effect``."""

from onlinebayes.simulators.effects.actuator_dead_zone import ActuatorDeadZone
from onlinebayes.simulators.effects.actuator_delay import ActuatorDelay
from onlinebayes.simulators.effects.actuator_gain import ActuatorGain
from onlinebayes.simulators.effects.actuator_lag import ActuatorLag
from onlinebayes.simulators.effects.actuator_saturation import ActuatorSaturation
from onlinebayes.simulators.effects.air_drag import AirDrag
from onlinebayes.simulators.effects.armature import Armature
from onlinebayes.simulators.effects.asymmetric_friction import AsymmetricFriction
from onlinebayes.simulators.effects.back_emf import BackEmf
from onlinebayes.simulators.effects.backlash import Backlash
from onlinebayes.simulators.effects.base import Effect, TargetKind
from onlinebayes.simulators.effects.cogging import Cogging
from onlinebayes.simulators.effects.com_offset import ComOffset
from onlinebayes.simulators.effects.constant_load import ConstantLoad
from onlinebayes.simulators.effects.contact_friction import ContactFriction
from onlinebayes.simulators.effects.contact_softness import ContactSoftness
from onlinebayes.simulators.effects.cubic_stiffness import CubicStiffness
from onlinebayes.simulators.effects.dry_friction import DryFriction
from onlinebayes.simulators.effects.gravity_tilt import GravityTilt
from onlinebayes.simulators.effects.joint_stiffness import JointStiffness
from onlinebayes.simulators.effects.load_dependent_friction import LoadDependentFriction
from onlinebayes.simulators.effects.load_dependent_stribeck import LoadDependentStribeck
from onlinebayes.simulators.effects.parameter_drift import ParameterDrift
from onlinebayes.simulators.effects.parameter_step import ParameterStep
from onlinebayes.simulators.effects.payload import Payload
from onlinebayes.simulators.effects.quadratic_drag import QuadraticDrag
from onlinebayes.simulators.effects.quadratic_load_friction import QuadraticLoadFriction
from onlinebayes.simulators.effects.scales import Contact, Scales
from onlinebayes.simulators.effects.seen import Reading, Seen, Servo
from onlinebayes.simulators.effects.sensor_bias import SensorBias
from onlinebayes.simulators.effects.sensor_clock import SensorClock
from onlinebayes.simulators.effects.sensor_delay import SensorDelay
from onlinebayes.simulators.effects.sensor_scale import SensorScale
from onlinebayes.simulators.effects.servo_law import ServoLaw
from onlinebayes.simulators.effects.stribeck_friction import StribeckFriction
from onlinebayes.simulators.effects.thermal_derating import ThermalDerating
from onlinebayes.simulators.effects.viscous_friction import ViscousFriction
from onlinebayes.simulators.effects.wind import Wind

EFFECTS: dict[str, type[Effect]] = {
    effect.name: effect
    for effect in (
        ViscousFriction,
        DryFriction,
        StribeckFriction,
        LoadDependentFriction,
        LoadDependentStribeck,
        QuadraticLoadFriction,
        AsymmetricFriction,
        QuadraticDrag,
        JointStiffness,
        CubicStiffness,
        ConstantLoad,
        Backlash,
        Cogging,
        Armature,
        Payload,
        ComOffset,
        AirDrag,
        Wind,
        GravityTilt,
        ActuatorGain,
        ActuatorLag,
        ActuatorDelay,
        ActuatorDeadZone,
        ActuatorSaturation,
        BackEmf,
        ServoLaw,
        ThermalDerating,
        SensorBias,
        SensorScale,
        SensorDelay,
        SensorClock,
        ContactFriction,
        ContactSoftness,
        ParameterDrift,
        ParameterStep,
    )
}
"""Every known effect by the contract's name; a module of one's own adds to it."""

__all__ = [
    "EFFECTS",
    "ActuatorDeadZone",
    "ActuatorDelay",
    "ActuatorGain",
    "ActuatorLag",
    "ActuatorSaturation",
    "AirDrag",
    "Armature",
    "AsymmetricFriction",
    "BackEmf",
    "Backlash",
    "Cogging",
    "ComOffset",
    "ConstantLoad",
    "Contact",
    "ContactFriction",
    "ContactSoftness",
    "CubicStiffness",
    "DryFriction",
    "Effect",
    "GravityTilt",
    "JointStiffness",
    "LoadDependentFriction",
    "LoadDependentStribeck",
    "ParameterDrift",
    "ParameterStep",
    "Payload",
    "QuadraticDrag",
    "QuadraticLoadFriction",
    "Reading",
    "Scales",
    "Seen",
    "SensorBias",
    "SensorClock",
    "SensorDelay",
    "SensorScale",
    "Servo",
    "ServoLaw",
    "StribeckFriction",
    "TargetKind",
    "ThermalDerating",
    "ViscousFriction",
    "Wind",
]
