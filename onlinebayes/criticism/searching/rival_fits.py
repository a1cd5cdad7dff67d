"""An effect in the place of an accepted one: which could take it, and the model refitted with it there."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.judging.acceptance import Judged, contained
from onlinebayes.criticism.judging.score import CrossValidated, cross_validate, parted
from onlinebayes.criticism.searching.stage import HOPELESS_RATIO, blocks_for
from onlinebayes.criticism.searching.working_model import carry_theta
from onlinebayes.identification.fitting.blocks import Blocks
from onlinebayes.identification.fitting.descent import bounded_step
from onlinebayes.identification.fitting.fit import Fit, improve, unfitted
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Rival:
    """An effect to put in another one's place, and where its refit begins: address -> value [SI]."""

    effect: Effect
    start: Mapping[str, float]


@dataclass(frozen=True)
class Incumbent:
    """The model as it stands, which rivals are held against.

    Args:
        grounds: it is fitted on.
        blocks, scores: its cross-validation.
    """

    grounds: Grounds
    blocks: Blocks
    scores: CrossValidated

    @classmethod
    def on(cls, grounds: Grounds, folds: int | None) -> Incumbent:
        """The model of these grounds, cross-validated; ``folds`` as in :class:`..results.Selection`."""
        blocks = blocks_for(grounds.fitted, grounds.windows, folds)
        return cls(grounds, blocks, cross_validate(grounds.fitted, grounds.windows, blocks))

    def validated(self, fitted: Fit) -> CrossValidated:
        """Another model's cross-validation on the same blocks."""
        return cross_validate(fitted, self.grounds.windows, self.blocks)

    def is_out_of_reach(self, begun: Fit) -> bool:
        """Whether a model's first step promises to leave many times the squared error, and is parted from this one."""
        _, promised = bounded_step(begun.simulator, begun.projected, begun.theta, 0.0)
        left, most = begun.projected.objective - promised, HOPELESS_RATIO * self.grounds.fitted.projected.objective
        return left > most and parted(self.scores, self.validated(begun), self.grounds.windows.bin_step)


def can_replace(accepted: Effect, other: Effect, present: Collection[str]) -> bool:
    """Whether an effect could take the accepted one's place; a richer one that contains it fits by construction.

    Args:
        accepted, other: the two.
        present: keys of all accepted effects.
    """
    nested = accepted.key in contained(other) or other.key in contained(accepted)
    return other.key not in present and not nested


def rival_as_judged(judged: Judged) -> Rival:
    """A rival at what its own round fitted."""
    simulator, theta = judged.fitted.simulator, judged.fitted.theta
    own = effect_entries(simulator, judged.effect)
    return Rival(judged.effect, {address: float(theta[simulator.parameters.index(address)]) for address in own})


def fit_with_rival(
    rival: Rival, simulator: Identifiable, effects: Sequence[Effect], incumbent: Incumbent, hopeless: float
) -> Fit | None:
    """The model with the rival in it, everything refitted from the model as it stands.

    Args:
        rival: what is put in.
        simulator: the base model at its own step.
        effects: all of the refitted model, the rival in its place.
        incumbent: the model as it stands.
        hopeless: an objective above which a fit that creeps is given up.

    Returns:
        None where it diverges, or where one look tells that it is out of reach.
    """
    grounds = incumbent.grounds
    current, windows = grounds.fitted, grounds.windows
    model = grounds.rung.of(grown(simulator, effects))
    theta = carry_theta(current.simulator, current.theta, model)
    for address, value in rival.start.items():
        theta[model.parameters.index(address)] = value
    try:
        begun = unfitted(model, windows, theta, current.projected.weight, current.lin.starts)
    except BadInput:
        return None
    return None if incumbent.is_out_of_reach(begun) else improve(begun, windows, hopeless)
