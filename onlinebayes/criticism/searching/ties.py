"""Effects that the data do not tell apart: could another one stand in the accepted one's place?

The first accepted effect is swapped, in the final model and with everything refitted, for each other that its round
judged (where it is the only one and the integrator stayed the same, its round has fitted just that) and for each that
looks like it at the final model (see :mod:`.candidates.lookalikes`); a later one is compared with its rivals in the
round that added it. What is not parted (see ``verdict``) is tied. Of a search that was stopped only what is fitted
already is compared.
"""

from __future__ import annotations

from onlinebayes.criticism.candidates.lookalikes import lookalikes
from onlinebayes.criticism.judging.acceptance import Judged
from onlinebayes.criticism.judging.verdict import tied
from onlinebayes.criticism.searching.rival_fits import Incumbent, Rival, can_replace, fit_with_rival, rival_as_judged
from onlinebayes.criticism.searching.search import SearchResult
from onlinebayes.criticism.searching.stage import HOPELESS_RATIO
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.simulators.identifiable import Identifiable

NEAR_ERROR_RATIO = 1.5
"""At a coarser step a rival may leave so many times the error of the one that was accepted."""

LOOKALIKE_Z_SHARE = 0.5
"""What looks like the accepted effect had this share of its z in the same round at least."""


def alternatives(base: Identifiable, found: SearchResult, folds: int | None) -> dict[str, tuple[str, ...]]:
    """Accepted effect -> the effects it cannot be told from.

    Args:
        base: the base model.
        found: what the search found.
        folds: number of blocks asked for.
    """
    equal: dict[str, tuple[str, ...]] = {}
    accepted = [judged.effect.key for _, judged in found.accepted]
    for k, (stage, judged) in enumerate(found.accepted):
        rivals = [r for r in stage.judged if r.fitted.converged and can_replace(judged.effect, r.effect, accepted)]
        # Two models may differ by nothing but how a coarse step damps the one and not the other.
        anew = found.final.rung != found.base.rung
        step = stage.windows.bin_step
        if k > 0 or found.interrupted or (len(found.accepted) == 1 and not anew):
            equal[judged.effect.key] = tuple(r.effect.key for r in rivals if tied(judged.scores, r.scores, step))
        elif len(found.accepted) == 1:
            near = [r for r in rivals if r.scores.rms_long < NEAR_ERROR_RATIO * judged.scores.rms_long]
            equal[judged.effect.key] = _swapped(base, found, [rival_as_judged(r) for r in near], folds)
        else:
            equal[judged.effect.key] = _swapped(base, found, [rival_as_judged(r) for r in rivals], folds)
        if k == 0 and not found.interrupted:
            equal[judged.effect.key] += _swapped(base, found, _overlooked(found, judged, accepted), folds)
    return equal


def _overlooked(found: SearchResult, first: Judged, accepted: list[str]) -> list[Rival]:
    """What its round saw much of and did not judge, or gave up, and looks like the first effect at the final model."""
    stage, final = found.accepted[0][0], found.final.fitted
    seen = {judged.effect.key for judged in stage.judged if judged.fitted.converged}
    z = {screened.effect.key: abs(screened.z or 0.0) for screened in stage.screened}
    others = [
        effect
        for effect in found.effects
        if effect.key not in seen
        and z.get(effect.key, 0.0) >= LOOKALIKE_Z_SHARE * z[first.effect.key]
        and effect.target_kind != "parameter"
        and can_replace(first.effect, effect, accepted)
    ]
    return [
        Rival(effect, {address: values[name] for address, name in effect_entries(final.simulator, effect).items()})
        for effect, values in lookalikes(final, found.final.windows, first.effect, others)
    ]


def _swapped(base: Identifiable, found: SearchResult, rivals: list[Rival], folds: int | None) -> tuple[str, ...]:
    """The rivals that do as well in the first effect's place, everything refitted."""
    if not rivals:
        return ()
    incumbent, windows = Incumbent.on(found.final, folds), found.final.windows
    beyond, equal = HOPELESS_RATIO * found.final.fitted.projected.objective, []
    for rival in rivals:
        effects = [rival.effect, *(judged.effect for _, judged in found.accepted[1:])]
        fitted = fit_with_rival(rival, base, effects, incumbent, beyond)
        if fitted is not None and tied(incumbent.scores, incumbent.validated(fitted), windows.bin_step):
            equal.append(rival.effect.key)
    return tuple(equal)
