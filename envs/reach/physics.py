"""The arm's model file, its physical parameters, and where its fingertip is."""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = Path(__file__).with_name("arm.xml")
"""Two links of 0.3 m on a turret, its joints 0.65 m above the floor: nothing of it can touch anything."""

DT = 0.04
"""Seconds between two commands [s]: eight timesteps of the model."""

UPPER, FORE, HEIGHT = 0.3, 0.3, 0.65  # lengths of the links, height of the shoulder [m]

PHYSICAL = ParameterSpace(
    {
        "body.upper.mass": Parameter(0.2, 2.0, "kg", "log"),
        "body.fore.mass": Parameter(0.1, 1.5, "kg", "log"),
        "joint.yaw.damping": Parameter(0.5, 8.0, "N m s/rad", "log"),
        "joint.shoulder.damping": Parameter(1.0, 16.0, "N m s/rad", "log"),
        "joint.elbow.damping": Parameter(0.5, 8.0, "N m s/rad", "log"),
        "actuator.yaw.gear": Parameter(2.0, 12.0, "N m"),
        "actuator.shoulder.gear": Parameter(5.0, 24.0, "N m"),
        "actuator.elbow.gear": Parameter(2.5, 12.0, "N m"),
    }
)
"""Eight parameters with physical bounds, not a prior: the links' masses, which the motors carry, the joints' damping
and the motors' strength, which together decide how fast a joint turns."""


def arm(parameters: ParameterSpace = PHYSICAL, worlds: int = 1, threads: int = 0) -> MujocoSimulator:
    """The arm, commanded every :data:`DT`.

    Args:
        parameters: the free ones, by address.
        worlds: number of worlds N.
        threads: threads that step them, 0 for all cores.
    """
    return MujocoSimulator(MODEL, parameters, worlds, DT, threads)


def fingertip(qpos: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Return the position of the fingertip (x, y, z) [m], at joint angles yaw, shoulder, elbow [rad]."""
    yaw, shoulder, elbow = qpos.unbind(-1)
    reach = UPPER * torch.cos(shoulder) + FORE * torch.cos(shoulder + elbow)
    rise = UPPER * torch.sin(shoulder) + FORE * torch.sin(shoulder + elbow)
    return torch.stack((reach * torch.cos(yaw), reach * torch.sin(yaw), HEIGHT + rise), dim=-1)
