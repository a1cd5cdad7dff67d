"""Worlds on ``mujoco.batch`` from any MJCF model."""

from onlinebayes.simulators.mujoco.simulator import MujocoSimulator

__all__ = ["MujocoSimulator"]
