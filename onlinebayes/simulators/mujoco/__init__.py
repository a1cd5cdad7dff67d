"""Worlds on ``mujoco.batch`` from any MJCF model."""

from onlinebayes.simulators.mujoco.native import NATIVE, JointField, NativeTerm
from onlinebayes.simulators.mujoco.simulator import MujocoSimulator

__all__ = ["NATIVE", "JointField", "MujocoSimulator", "NativeTerm"]
