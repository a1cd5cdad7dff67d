"""A skid-steered robot that drives along a circle: section 5.4.3 of the thesis."""

from envs.skid_steer.kinematics import MAX_WHEEL_SPEED, PHYSICAL, SkidSteerKinematics
from envs.skid_steer.task import CircleTask

__all__ = ["MAX_WHEEL_SPEED", "PHYSICAL", "CircleTask", "SkidSteerKinematics"]
