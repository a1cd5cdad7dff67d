"""One way to integrate a model: step, method, and whose friction and moments of inertia.

A first-order integrator errs by h times the motion's rates: on a two-link arm at MuJoCo's default of Euler and 2 ms by
twice a millimetre-class sensor's noise within a second, and at a sixteenth of that still by a tenth. Runge-Kutta's
method errs by h^4 where the motion is smooth, by h where friction sticks, and costs four evaluations a step; it
diverges where a model is stiff. There a method of first order is extrapolated from two steps: see
:mod:`.extrapolated`. Which way is fine enough is asked in :mod:`.fitting.discretisation`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeVar

from onlinebayes.identification.replaying.extrapolated import in_two_steps, replayed_in_two_steps
from onlinebayes.identification.replaying.wrapper import unwrap
from onlinebayes.simulators.abilities import Integrated

Method = Literal["own", "runge_kutta", "first_order", "extrapolated"]
TOLD: dict[Method, str] = {
    "own": "the model's own method",
    "runge_kutta": "Runge-Kutta's method",
    "first_order": "a method of first order",
    "extrapolated": "the model's own method, extrapolated from whole and half steps,",
}
S = TypeVar("S", bound=Integrated)

FINEST = 16
"""Parts of the model's own step that is the shortest: by it a report integrates what was judged by extrapolation."""


@dataclass(frozen=True)
class Integration:
    """One way to run a model.

    Args:
        timestep: h [s].
        method: the model's own; Runge's and Kutta's or one of first order in its place; the own one, of first order,
            extrapolated from this step and half of it.
        soft_friction: dry friction as soft as the engine has it, in place of one that sticks.
        scaled_moments: moments of inertia that follow the free masses, in place of the model's own.
    """

    timestep: float
    method: Method = "own"
    soft_friction: bool = False
    scaled_moments: bool = False

    @property
    def told(self) -> str:
        """The method in words."""
        return TOLD[self.method]

    def of(self, simulator: S) -> S:
        """The simulator run so; itself where it is already."""
        chosen = simulator.with_runge_kutta() if self.method == "runge_kutta" else simulator
        chosen = chosen.with_first_order() if self.method == "first_order" else chosen
        chosen = chosen.with_soft_friction() if self.soft_friction else chosen
        chosen = chosen.with_scaled_moments() if self.scaled_moments else chosen
        chosen = chosen if self.timestep == chosen.timestep else chosen.with_timestep(self.timestep)
        return in_two_steps(chosen) if self.method == "extrapolated" else chosen


def reported(simulator: Integrated, *fitted: Integrated) -> Integration:
    """Choose the integration of fitted models in reports: no longer steps than the given one's, and no cheaper method.

    Args:
        simulator: as the user gave it.
        fitted: models that grew from it, each integrated as it was judged.
    """
    models = (simulator, *fitted)
    steps = [model.timestep for model in models]
    if any(map(replayed_in_two_steps, fitted)):
        steps.append(simulator.timestep / FINEST)  # a file and its user integrate in one way
    return Integration(min(steps), "runge_kutta" if any(map(by_runge_kutta, models)) else "own")


def adjustable(simulator: Integrated) -> bool:
    """Check whether the simulator can integrate with another step."""
    return type(unwrap(simulator)).with_timestep is not Integrated.with_timestep


def first_order(simulator: Integrated) -> bool:
    """Check whether the model's own method is another than Runge's and Kutta's, which it could have."""
    return _has_methods(simulator) and simulator.with_runge_kutta() is not simulator


def by_runge_kutta(simulator: Integrated) -> bool:
    """Check whether the model's own method is Runge's and Kutta's, and could be another."""
    return _has_methods(simulator) and simulator.with_runge_kutta() is simulator


def _has_methods(simulator: Integrated) -> bool:
    return type(unwrap(simulator)).with_runge_kutta is not Integrated.with_runge_kutta
