"""Planar hoppers: one of twenty physical parameters on ``mujoco.batch``, and Gymnasium's in MuJoCo and in Drake."""

from envs.hopper.drake import DrakeHopper
from envs.hopper.physics import DT, MODEL, PHYSICAL, hopper
from envs.hopper.standard import FRICTION, STANDARD, STANDARD_MODEL, standard_hopper, standard_task
from envs.hopper.task import HopperTask

__all__ = [
    "DT",
    "FRICTION",
    "MODEL",
    "PHYSICAL",
    "STANDARD",
    "STANDARD_MODEL",
    "DrakeHopper",
    "HopperTask",
    "hopper",
    "standard_hopper",
    "standard_task",
]
