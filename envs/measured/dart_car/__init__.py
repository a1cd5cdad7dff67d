"""A 1/10 scale car: its speed on a straight (``longitudinal``), and a single track for its circles (``lateral``)."""

from envs.measured.dart_car.single_track import SingleTrack, build

__all__ = ["SingleTrack", "build"]
