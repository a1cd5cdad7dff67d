"""Measured trajectories: what was commanded and what the sensors read, from tables or arrays."""

from onlinebayes.measurements.known_starts import KnownStart
from onlinebayes.measurements.mapping import CommandColumn, SignalColumn, TimeColumn
from onlinebayes.measurements.measurement import BetweenRows, Measurement, Signal, concatenate
from onlinebayes.measurements.tables import TableReader

__all__ = [
    "BetweenRows",
    "CommandColumn",
    "KnownStart",
    "Measurement",
    "Signal",
    "SignalColumn",
    "TableReader",
    "TimeColumn",
    "concatenate",
]
