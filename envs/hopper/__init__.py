"""A planar hopper on ``mujoco.batch`` with twenty physical parameters."""

from envs.hopper.physics import DT, MODEL, PHYSICAL, hopper
from envs.hopper.task import HopperTask

__all__ = ["DT", "MODEL", "PHYSICAL", "HopperTask", "hopper"]
