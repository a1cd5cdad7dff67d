"""Measured trajectories: what was commanded and what the sensors read, from tables or arrays."""

from onlinebayes.measurements.measurement import Measurement, Signal, concatenate
from onlinebayes.measurements.tables import SignalColumn, TableReader

__all__ = ["Measurement", "Signal", "SignalColumn", "TableReader", "concatenate"]
