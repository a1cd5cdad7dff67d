"""An arm of two links on a turret that brings its fingertip to a goal, on ``mujoco.batch``."""

from envs.reach.physics import DT, MODEL, PHYSICAL, arm, fingertip
from envs.reach.task import ReachTask

__all__ = ["DT", "MODEL", "PHYSICAL", "ReachTask", "arm", "fingertip"]
