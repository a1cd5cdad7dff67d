"""The numerical integration of a simulator, and the same system integrated in another way."""

from __future__ import annotations

from typing import Self

from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.checks import timesteps_of


class Integrated(Simulator):
    """A simulator with a timestep; by default it is integrated in one way only.

    Attributes:
        timestep: seconds of one integration step [s]; ``dt`` is a whole number of them.
    """

    timestep: float

    def with_timestep(self, timestep: float) -> Self:
        """A new simulator that integrates with this step [s] and whose ``dt`` is one of them; all worlds nominal.

        Raises:
            BadInput: this simulator's step cannot be changed.
        """
        raise BadInput(
            f"{type(self).__name__} integrates with a step of {self.timestep:g} s only",
            "override with_timestep to let numerics be checked",
        )

    def with_dt(self, dt: float) -> Self:
        """The same system whose :meth:`step` lasts ``dt`` seconds [s], integrated as before; all worlds nominal.

        Raises:
            BadInput: ``dt`` is no whole number of timesteps, or this simulator's cannot be changed.
        """
        if timesteps_of(dt, self.timestep) == timesteps_of(self.dt, self.timestep):
            return self
        raise BadInput(f"a step of {type(self).__name__} lasts {self.dt:g} s", "override with_dt to let it be chosen")

    def with_runge_kutta(self) -> Self:
        """The same system integrated by Runge and Kutta's method of fourth order; itself where it is already.

        Raises:
            BadInput: this simulator has one integrator only.
        """
        raise BadInput(
            f"{type(self).__name__} has one integrator only",
            "override with_runge_kutta to let numerics be checked at coarse steps",
        )

    def with_first_order(self) -> Self:
        """The same system, steps and all, by a method of first order that evaluates its forces once a step.

        For what needs many replays and few digits. Itself where it is integrated so already, or by one method only.
        """
        return self

    def with_soft_friction(self) -> Self:
        """The same system with the engine's own soft dry friction where effects made it stick; itself without such."""
        return self

    def with_scaled_moments(self) -> Self:
        """The same system, moments of inertia in proportion to the free masses; itself where that changes nothing."""
        return self
