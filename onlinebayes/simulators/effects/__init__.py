"""The vocabulary of physical effects: named terms with bounded parameters, added with ``simulator.with_effect``."""

from onlinebayes.simulators.effects.base import Effect, Scales

__all__ = ["Effect", "Scales"]
