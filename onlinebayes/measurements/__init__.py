"""Measured trajectories: what was commanded and what the sensors read, from tables or arrays."""

from onlinebayes.measurements.measurement import Measurement, Signal, concatenate

__all__ = ["Measurement", "Signal", "concatenate"]
