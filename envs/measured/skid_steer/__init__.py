"""A skid-steered vehicle on the ground; ``build`` is the factory that its problem file names."""

from envs.measured.skid_steer.vehicle import SkidSteer, build

__all__ = ["SkidSteer", "build"]
