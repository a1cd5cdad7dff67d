"""The model as it stands between two rounds of the search, and the moves that make the next one of it.

with effects    everything fitted anew, at a step that is fine enough for what entered
with a change   a parameter has a value of its own in every run from here on
without         what may be nothing now that others came
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.judging.acceptance import contained, interval
from onlinebayes.criticism.searching.changes import Changed
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.stage import Added, blocks_for
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class WorkingModel:
    """A model that may be improved.

    Args:
        simulator: the base model at its own step, with a value in every run of what was found to differ between them.
        grounds: it and what was accepted, fitted.
        accepted: the effects, each with the round that added it.
        changes: the parameters that were given one value a run.
    """

    simulator: Identifiable
    grounds: Grounds
    accepted: tuple[Added, ...] = ()
    changes: tuple[Changed, ...] = ()

    @property
    def effects(self) -> list[Effect]:
        """The accepted effects."""
        return [judged.effect for _, judged in self.accepted]

    def untried(self, effects: Sequence[Effect]) -> list[Effect]:
        """Those that are neither accepted nor contained in one that is."""
        present = {effect.key for effect in self.effects}.union(*(contained(effect) for effect in self.effects))
        return [effect for effect in effects if effect.key not in present]

    def at_floor(self, tolerance: float) -> bool:
        """Whether the residual is the sensors' noise, so that only a significant candidate is worth a refit."""
        return misfit(self.grounds.fitted.projected) <= tolerance


def with_effects(working: WorkingModel, added: Sequence[Added], context: SearchContext) -> WorkingModel:
    """The model with these effects, the last of which was fitted with all the others.

    Args:
        working: the model.
        added: what enters.
        context: of the search.
    """
    accepted = (*working.accepted, *added)
    model, best = grown(working.simulator, [judged.effect for _, judged in accepted]), added[-1][1].fitted
    before, horizon = working.grounds, context.selection.horizon_s
    noise = before.windows.noise
    grounds = settle(model, context.measurement, horizon, noise, best.theta, before=before, fitted=best)
    return replace(working, grounds=grounds, accepted=accepted)


def with_change(working: WorkingModel, change: Changed) -> WorkingModel:
    """The model with a parameter that differs between runs."""
    changes = (*working.changes, change)
    return replace(working, simulator=change.simulator, grounds=change.grounds, changes=changes)


def drop_idle(working: WorkingModel, earlier: Sequence[Added], context: SearchContext) -> WorkingModel | None:
    """The model without an ``earlier`` effect that may now be nothing; None where all are needed."""
    fitted, windows = working.grounds.fitted, working.grounds.windows
    selection = context.selection
    blocks = blocks_for(fitted, windows, selection.folds)
    for idle in earlier:
        effect = idle[1].effect
        low, high = interval(fitted, blocks, effect)
        if low <= effect.neutral[effect.magnitude] <= high:
            kept = tuple(item for item in working.accepted if item is not idle)
            model = grown(working.simulator, [judged.effect for _, judged in kept])
            theta = carry_theta(fitted.simulator, fitted.theta, model)
            noise, before = windows.noise, working.grounds
            grounds = settle(model, context.measurement, selection.horizon_s, noise, theta, before)
            return replace(working, grounds=grounds, accepted=kept)
    return None


def carry_theta(source: Identifiable, theta: Float[Tensor, " P"], target: Identifiable) -> Float[Tensor, " Q"]:
    """Theta of ``target``: the values of ``source`` where it has the same parameter, else nominal ones."""
    values = dict(zip(source.parameters, theta.unbind(), strict=True))
    nominal = target.nominal.to(theta)
    rows = [values.get(name, nominal[i]) for i, name in enumerate(target.parameters)]
    return torch.stack(rows) if rows else nominal
