"""Simulators: many worlds at once, each with its own physical parameters."""

from onlinebayes.simulators.base import Simulator

__all__ = ["Simulator"]
