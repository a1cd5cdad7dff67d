"""Inputs that every simulator refuses, whatever steps it: a ``dt`` between timesteps, an effect that it already has."""

from __future__ import annotations

import math
from collections.abc import Sequence

from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect


def timesteps_of(dt: float, timestep: float) -> int:
    """Return the number of timesteps in a step.

    Args:
        dt: length of a step [s].
        timestep: of one integration step [s], positive.

    Raises:
        BadInput: ``dt`` is no whole number of timesteps, to a millionth of it.
    """
    steps = round(dt / timestep)
    if steps < 1 or not math.isclose(steps * timestep, dt, rel_tol=1e-6):
        raise BadInput(f"dt = {dt:g} s", f"it must be a whole number of timesteps of {timestep:g} s")
    return steps


def refuse_twice(effect: Effect, effects: Sequence[Effect]) -> None:
    """Raise :class:`BadInput` for an effect that is one of these already."""
    if any(effect.key == other.key for other in effects):
        raise BadInput(f"{effect.key} is already part of the simulator", "add each effect once")
