"""Two skid-steered vehicles on the ground; ``build`` and ``build_warthog`` are what their problem files name."""

from envs.measured.skid_steer.vehicle import SkidSteer, Warthog, build, build_warthog

__all__ = ["SkidSteer", "Warthog", "build", "build_warthog"]
