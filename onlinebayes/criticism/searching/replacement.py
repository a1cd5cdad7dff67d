"""An effect in the place of an accepted one: which could take it, and the model refitted with it there."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.fitting.descent import bounded_step
from onlinebayes.criticism.fitting.fit import Fit, improve, unfitted
from onlinebayes.criticism.fitting.numerics import Grounds
from onlinebayes.criticism.judging.acceptance import Judged, contained
from onlinebayes.criticism.replaying.scoped import effect_entries
from onlinebayes.criticism.searching.stage import HOPELESS_RATIO
from onlinebayes.criticism.searching.standing import carried
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Effect


@dataclass(frozen=True)
class Rival:
    """An effect to put in another one's place, and where its refit begins: address -> value [SI]."""

    effect: Effect
    start: Mapping[str, float]


def can_replace(accepted: Effect, other: Effect, present: Collection[str]) -> bool:
    """Whether an effect could take the accepted one's place; a richer one that contains it fits by construction.

    Args:
        accepted, other: the two.
        present: keys of all accepted effects.
    """
    nested = accepted.key in contained(other) or other.key in contained(accepted)
    return other.key not in present and not nested


def as_judged(judged: Judged) -> Rival:
    """A rival at what its own round fitted."""
    simulator, theta = judged.fitted.simulator, judged.fitted.theta
    own = effect_entries(simulator, judged.effect)
    return Rival(judged.effect, {address: float(theta[simulator.parameters.index(address)]) for address in own})


def refitted_with(
    rival: Rival, simulator: Simulator, effects: Sequence[Effect], grounds: Grounds, hopeless: float
) -> Fit | None:
    """The model with the rival in it, everything refitted from the model as it stands; None where it diverges.

    None, too, where its first step promises to leave many times what the model as it stands does: that is no rival.

    Args:
        rival: what is put in.
        simulator: the base model at its own step.
        effects: all of the refitted model, the rival in its place.
        grounds: the model as it stands, fitted.
        hopeless: an objective above which a fit that creeps is given up.
    """
    current, windows = grounds.fitted, grounds.windows
    model = grounds.rung.of(grown(simulator, effects))
    theta = carried(current.simulator, current.theta, model)
    for address, value in rival.start.items():
        theta[model.parameters.index(address)] = value
    try:
        begun = unfitted(model, windows, theta, current.projected.weight, current.lin.starts)
    except BadInput:
        return None
    _, promised = bounded_step(model, begun.projected, begun.theta, 0.0)
    if begun.projected.objective - promised > HOPELESS_RATIO * current.projected.objective:
        return None
    return improve(begun, windows, hopeless)
