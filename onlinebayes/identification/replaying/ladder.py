"""How finely a model is integrated, from coarse to fine.

    first order:     H / 100, where the model's own integrator is Runge's and Kutta's
    own integrator:  H / 100, halved down to the model's own step h, those that the log's rows fall on
    Runge-Kutta:     the same steps, h / 2 and h / 4, where the model's own integrator is another
    own integrator:  h / 4, h / 16, unless a law is walked step by step and a window would take more than 4000

A first-order integrator errs by h times the motion's rates: on a two-link arm at MuJoCo's default of Euler and 2 ms by
twice a millimetre-class sensor's noise within a second, and at a sixteenth of that still by a tenth. Runge-Kutta's
method errs by h^4 where the motion is smooth, by h where friction sticks, and costs four evaluations a step: while the
misfit is gross, one is enough. Where rows do not fall on steps, commands are averaged across their changes, which errs
by more than any of these.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from onlinebayes.identification.data.tiling import BINS
from onlinebayes.identification.replaying.wrapper import unwrap
from onlinebayes.simulators.identifiable import Identifiable

Method = Literal["own", "runge_kutta", "first_order"]

MOST_WALKED = 4000
"""Steps of a window that are walked one by one at most, for a law that stands beside the engine. A fit of a turntable
with Stribeck friction took three minutes at four times as many, and they were not exact enough either."""

ON_STEPS = 0.01  # steps by which a row may miss a whole number of them


@dataclass(frozen=True)
class Rung:
    """One way to run a model.

    Args:
        timestep: h [s].
        method: the model's own, or Runge's and Kutta's or one of first order in its place.
        soft_friction: dry friction as soft as the engine has it, in place of one that sticks.
        scaled_moments: moments of inertia that follow the free masses, in place of the model's own.
    """

    timestep: float
    method: Method = "own"
    soft_friction: bool = False
    scaled_moments: bool = False

    def of(self, simulator: Identifiable) -> Identifiable:
        """The simulator run so; itself where it is already."""
        chosen = simulator.with_runge_kutta() if self.method == "runge_kutta" else simulator
        chosen = chosen.with_first_order() if self.method == "first_order" else chosen
        chosen = chosen.with_soft_friction() if self.soft_friction else chosen
        chosen = chosen.with_scaled_moments() if self.scaled_moments else chosen
        return chosen if self.timestep == chosen.timestep else chosen.with_timestep(self.timestep)

    def like(self, other: Rung) -> Rung:
        """This step and method, with the other's friction and moments."""
        return replace(self, soft_friction=other.soft_friction, scaled_moments=other.scaled_moments)


def ladder(simulator: Identifiable, horizon: float, row: float) -> list[Rung]:
    """The rungs for windows of ``horizon`` [s] of a log with rows ``row`` [s] apart, coarse to fine.

    Only the model's own where its step is fixed.
    """
    own = simulator.timestep
    if not adjustable(simulator):
        return [Rung(own)]
    factor, steps = max(1, int(horizon / BINS / own + 1e-9)), []
    while factor >= 1:
        if factor == 1 or _whole(factor * own, row):
            steps.append(factor * own)
        factor //= 2
    rungs = [Rung(step) for step in steps]
    if by_runge_kutta(simulator) and simulator.with_first_order() is not simulator:
        rungs.insert(0, Rung(steps[0], "first_order"))
    if first_order(simulator):
        rungs += [Rung(step, "runge_kutta") for step in (*steps, own / 2, own / 4)]
    finest = [Rung(own / 4), Rung(own / 16)]
    return [*rungs, *(rung for rung in finest if affordable(simulator, rung.timestep, horizon))]


def affordable(simulator: Identifiable, timestep: float, horizon: float) -> bool:
    """Whether windows of ``horizon`` [s] do not take too many steps [s] for a simulator that is walked one by one."""
    walked = any(effect.staged for effect in simulator.effects)
    return not walked or horizon <= MOST_WALKED * timestep * (1 + 1e-9)


def reported(simulator: Identifiable, *fitted: Identifiable) -> Rung:
    """How fitted models are run that are reported: in no longer steps than the given one, and by no cheaper method.

    Args:
        simulator: as the user gave it.
        fitted: models that grew from it, each integrated as it was judged.
    """
    models = (simulator, *fitted)
    return Rung(min(model.timestep for model in models), "runge_kutta" if any(map(by_runge_kutta, models)) else "own")


def _whole(step: float, row: float) -> bool:
    """Whether a row is a whole number of steps, or a step one of rows."""
    ratio = max(step, row) / min(step, row)
    return abs(ratio - round(ratio)) < ON_STEPS


def adjustable(simulator: Identifiable) -> bool:
    """Whether the simulator can integrate with another step."""
    return type(unwrap(simulator)).with_timestep is not Identifiable.with_timestep


def first_order(simulator: Identifiable) -> bool:
    """Whether the model's own method is another than Runge's and Kutta's, which it could have."""
    return _has_methods(simulator) and simulator.with_runge_kutta() is not simulator


def by_runge_kutta(simulator: Identifiable) -> bool:
    """Whether the model's own method is Runge's and Kutta's, and could be another."""
    return _has_methods(simulator) and simulator.with_runge_kutta() is simulator


def _has_methods(simulator: Identifiable) -> bool:
    return type(unwrap(simulator)).with_runge_kutta is not Identifiable.with_runge_kutta
