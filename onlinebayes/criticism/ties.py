"""Effects that the data do not tell apart: could another one stand in the accepted one's place?

The first accepted effect is swapped, in the final model and with everything refitted, for each other that its round
judged (where it is the only one and the integrator stayed the same, its round has fitted just that); a later one is
compared with its rivals in the round that added it. What is not parted (see ``verdict``) is tied.
"""

from __future__ import annotations

from onlinebayes.criticism.acceptance import contained
from onlinebayes.criticism.candidates import grown
from onlinebayes.criticism.fit import fit
from onlinebayes.criticism.scoped import effect_entries
from onlinebayes.criticism.score import cross_validate
from onlinebayes.criticism.search import Found, carried
from onlinebayes.criticism.stage import GROSS, blocks_for
from onlinebayes.criticism.verdict import tied
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

NEAR = 1.5  # times the error of the one that was accepted: what a rival may leave at a coarser step


def alternatives(base: Simulator, found: Found, folds: int | None) -> dict[str, tuple[str, ...]]:
    """Accepted effect -> the effects it cannot be told from.

    Args:
        base: the base model.
        found: what the search found.
        folds: number of blocks asked for.
    """
    equal: dict[str, tuple[str, ...]] = {}
    accepted = [judged.effect.key for _, judged in found.accepted]
    for k, (stage, judged) in enumerate(found.accepted):
        # A richer effect that contains this one is no rival: it fits as well by construction.
        rivals = [
            other
            for other in stage.judged
            if other.effect.key not in accepted
            and judged.effect.key not in contained(other.effect)
            and other.effect.key not in contained(judged.effect)
        ]
        # Two models may differ by nothing but how a coarse step damps the one and not the other.
        anew = found.final.rung != found.base.rung
        if anew and len(found.accepted) == 1:
            rivals = [r for r in rivals if r.scores.rms_long < NEAR * judged.scores.rms_long]
        if k > 0 or (len(found.accepted) == 1 and not anew):
            step = stage.windows.bin_step
            equal[judged.effect.key] = tuple(r.effect.key for r in rivals if tied(judged.scores, r.scores, step))
        else:
            equal[judged.effect.key] = _swapped(base, found, [r.effect.key for r in rivals], folds)
    return equal


def _swapped(base: Simulator, found: Found, rivals: list[str], folds: int | None) -> tuple[str, ...]:
    windows, final = found.final.windows, found.final.fitted
    blocks = blocks_for(final, windows, folds)
    scores = cross_validate(final, windows, blocks)
    first = found.accepted[0][0]
    equal = []
    for rival in first.judged:
        if rival.effect.key not in rivals:
            continue
        effects = [rival.effect, *(judged.effect for _, judged in found.accepted[1:])]
        model = found.final.rung.of(grown(base, effects))
        theta = carried(final.simulator, final.theta, model)
        for address in effect_entries(model, rival.effect):
            source = rival.fitted.simulator.parameters.index(address)
            theta[model.parameters.index(address)] = rival.fitted.theta[source]
        try:
            beyond = GROSS * final.projected.objective
            fitted = fit(model, windows, theta, final.projected.weight, hopeless=beyond)
        except BadInput:
            continue
        if tied(scores, cross_validate(fitted, windows, blocks), windows.bin_step):
            equal.append(rival.effect.key)
    return tuple(equal)
