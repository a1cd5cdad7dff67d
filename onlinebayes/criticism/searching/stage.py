"""One round of the search: every candidate screened against the current model, the best refitted and judged.

Where the current residual is correlated for so long that it leaves fewer than 7 independent parts, the misfit itself
may be what is slow. Then it is taken as uncorrelated, and only a candidate is admissible whose own residual allows 7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from onlinebayes.criticism.candidates.longer import longer
from onlinebayes.criticism.candidates.survey import Screened, Survey, survey
from onlinebayes.criticism.judging.acceptance import LEAST_FALL, Judged, contained, judge
from onlinebayes.criticism.judging.score import CrossValidated
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import FEWEST_BLOCKS, Blocks, independent_parts, make_blocks
from onlinebayes.identification.fitting.fit import Fit, fit, residual_correlation_time, still_promised
from onlinebayes.identification.fitting.inactive_effects import restart_inactive_effects
from onlinebayes.identification.fitting.projection import misfit, project
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.identification.results import Numerics, Selection
from onlinebayes.runs import UNWATCHED, BadInput, Watch
from onlinebayes.simulators.effects import Effect

REFIT_BELOW = 0.1
"""In a thorough round candidates whose p lies below this are refitted, for ties and the report."""

FEWEST_REFITS, MOST_REFITS_OF_A_ROUND = 2, 5
"""A thorough round refits so many candidates at least, and any round so many at most."""

HOPELESS_RATIO = 4.0
"""A rival's fit that creeps is given up above so many times the squared error of an admissible model."""

GROSS_FLOORS = 3.0
"""A misfit above so many floors is gross: something is missing for certain."""

MOST_FLOORS = 1000.0
"""A misfit above so many floors remains of a real machine whose own effects were found: no other leaves noise of it."""

EVERY_P = math.inf
"""The level at which nothing is refused for its p."""

LEAST_PROMISED_FALL = 0.4 * LEAST_FALL
"""What promises to lower the error by a smaller share, to first order, will not lower it as acceptance asks."""

LEAST_PROMISE_OF_GROSS = 0.1
"""A candidate that promises to lower a gross misfit by this share is worth a refit, whatever its p."""

MUCH_PROMISED = 0.25
"""A candidate that promises to lower the misfit by this share promises much."""

LEAST_REALISED = 0.1
"""A refit that realises less than this part of much that was promised was led astray."""

HALF_REALISED = 0.5
"""A limit's refit that realises less than this part of much that was promised may have stopped at its peaks."""

STUCK = 0.1
"""A refit that ends where one more step promises to lower its squared error by a larger share stopped on its way."""

LEFT_OF_GROSS = 0.25
"""A candidate that leaves no more than this share of a gross misfit needs no p."""


@dataclass(frozen=True)
class Stage:
    """The current model, its blocks and scores, all candidates screened (best first) and the leading ones judged."""

    current: Fit
    windows: Windows
    blocks: Blocks
    scores: CrossValidated
    screened: tuple[Screened, ...]
    judged: tuple[Judged, ...]


Added = tuple[Stage, Judged]
"""An effect and the round that adds it."""


def blocks_for(fitted: Fit, windows: Windows, folds: int | None) -> Blocks:
    """The blocks that the correlation of this fit's residual allows."""
    return make_blocks(windows, residual_correlation_time(fitted, windows), folds)


def run_stage(
    current: Fit,
    windows: Windows,
    effects: Sequence[Effect],
    numerics: Numerics,
    selection: Selection,
    watch: Watch = UNWATCHED,
    thorough: bool = True,
) -> Stage:
    """Screen all effects against the current model, refit the leading ones and judge them.

    Args:
        current, windows, numerics: the model as it stands, and what it was fitted on.
        effects: the candidates.
        selection: how they are judged.
        watch: looked at between the refits; those that are left are then not judged.
        thorough: refit two at least and all below p = .1, for ties and the report; else those that may be accepted.
    """
    found = survey(current, windows, effects, selection.folds)
    fewest, below = (FEWEST_REFITS, REFIT_BELOW) if thorough else (0, selection.alpha)
    leading, promising = _leading(found, selection.alpha), worth(found, selection.alpha, below)
    refits = [s for k, s in enumerate(leading) if k < fewest or s in promising][:MOST_REFITS_OF_A_ROUND]
    stage = judged_stage(found, refits, numerics, selection, watch)
    more = [s for s in unlikely(found) if s not in refits]
    if not more or _any_admissible(stage):
        return stage
    rest = judged_stage(found, more, numerics, selection, watch)
    # What is neither likely nor explains anything leads no pairs: each lead costs a screening of all and refits.
    return replace(stage, judged=(*stage.judged, *rest.judged)) if _any_admissible(rest) else stage


def _any_admissible(stage: Stage) -> bool:
    return any(judged.admissible for judged in stage.judged)


def _leading(found: Survey, alpha: float) -> list[Screened]:
    """Those that may be refitted, best first.

    A richer effect waits for the significant simpler one that it contains: it would fit as well by construction.
    """
    leading = [s for s in found.screened if s.p_value is not None]
    seen = {s.effect.key for s in leading if (s.p_value or 0.0) < alpha}
    return [s for s in leading if not seen & contained(s.effect)]


def unlikely(found: Survey) -> list[Screened]:
    """Those that promise most of a gross misfit, whatever their p: screening is linear, and sees little of a limit."""
    if not GROSS_FLOORS < misfit(found.current.projected) <= MOST_FLOORS:
        return []
    promising = [s for s in _leading(found, 0.0) if s.promise >= LEAST_PROMISE_OF_GROSS]
    return sorted(promising, key=lambda s: -s.promise)[:FEWEST_REFITS]


def worth(found: Survey, alpha: float, below: float) -> list[Screened]:
    """Those of p under ``below`` that promise to lower the error."""
    return [s for s in _leading(found, alpha) if (s.p_value or 0.0) < below and s.promise >= LEAST_PROMISED_FALL]


def judged_stage(
    found: Survey,
    refits: Sequence[Screened],
    numerics: Numerics,
    selection: Selection,
    watch: Watch = UNWATCHED,
    hopeless: float = math.inf,
) -> Stage:
    """The round in which these candidates are refitted and judged; above ``hopeless`` a fit that creeps is given up."""
    judged: list[Judged] = []
    for k, candidate in enumerate(refits, 1):
        if watch.stopped:
            break
        watch.say(f"refitting {k} of {len(refits)}: {candidate.effect.key}")
        best = min((j.fitted.projected.objective for j in judged if j.admissible), default=math.inf)
        try:
            fitted, effect = refit(
                found.current,
                found.windows,
                candidate.effect,
                candidate.start,
                min(hopeless, HOPELESS_RATIO * best),
                candidate.others,
                candidate.promise,
            )
        except BadInput:  # it diverges from where screening would start it
            continue
        p = candidate.p_value or 0.0
        level = EVERY_P if explains(found.current, fitted, found.windows, selection) else selection.alpha
        judged.append(judged_in(found, effect, p, fitted, numerics, selection, level))
    return Stage(found.current, found.windows, found.blocks, found.scores, found.screened, tuple(judged))


def explains(current: Fit, fitted: Fit, windows: Windows, selection: Selection) -> bool:
    """Whether a candidate leaves noise, or a quarter, of a gross misfit, which nothing does by chance.

    Screening's p says nothing more then: it is linear, and sees little of a limit, or of a spring whose centre is free.
    """
    gross = misfit(current.projected)
    most = max(selection.tolerance, LEFT_OF_GROSS * gross)
    return gross > GROSS_FLOORS and misfit(project(windows, fitted.lin)) <= most


def leaves_noise(fitted: Fit, windows: Windows, tolerance: float) -> bool:
    """Whether no signal errs by more than ``tolerance`` floors."""
    return misfit(project(windows, fitted.lin)) <= tolerance


def judged_in(
    found: Survey,
    effect: Effect,
    p_value: float,
    fitted: Fit,
    numerics: Numerics,
    selection: Selection,
    level: float,
) -> Judged:
    """One effect of a survey, refitted, under all rules; where its model's residual is slow, under one more.

    Args:
        found: the model without the effect, all candidates screened.
        effect, p_value: the effect, and its p of the screening.
        fitted: the model with it.
        numerics, selection: of the integration step, and how effects are judged.
        level: which p must stay below.
    """
    windows, tried = found.windows, len(found.screened)
    judged = judge(effect, p_value, fitted, found.scores, windows, found.blocks, numerics, level, tried)
    return _if_slow(judged, windows, selection) if found.slow else judged


def _if_slow(judged: Judged, windows: Windows, selection: Selection) -> Judged:
    """The judgement, with a failure more where what the candidate leaves is as slow as what it found."""
    count = independent_parts(windows, residual_correlation_time(judged.fitted, windows), selection.folds)
    if count >= FEWEST_BLOCKS:
        return judged
    slow = f"what it leaves is slow: {count} independent blocks, not {FEWEST_BLOCKS}"
    return replace(judged, failed=(*judged.failed, slow), undecided=not judged.failed)


def refit(
    current: Fit,
    windows: Windows,
    effect: Effect,
    start: dict[str, float],
    hopeless: float = math.inf,
    others: Sequence[dict[str, float]] = (),
    promised: float = 0.0,
) -> tuple[Fit, Effect]:
    """The current model with ``effect`` added, fitted to convergence from ``start``; ``hopeless`` as for ``fit``.

    The linear estimate of a limit may lie where it limits nothing, which a fit cannot leave: see
    :mod:`.fitting.inactive_effects`. Where there are ``others`` to begin from, the best of all these fits. The grown
    model contains the current one: a fit that ends above it, or realises next to nothing of much that screening
    ``promised`` (a share of the RMS), was led astray from where it began, and begins again half-way to nothing, and at
    nothing. One that is stuck on its way begins again at nothing and at the effect's own starting values (a weak spring
    that rests far away, on its way to a stronger one that rests near).

    Returns:
        The fit, and the effect as it was fitted: a time that ended on its bound has a longer one (see
        :mod:`.candidates.longer`).
    """
    fitted = _fitted(current, windows, effect, start, hopeless)
    realised = 1 - math.sqrt(fitted.projected.objective / max(current.projected.objective, 1e-300))
    astray = realised < 0 or (promised >= MUCH_PROMISED and realised < LEAST_REALISED * promised)
    nearer = [_halved(effect, start), dict(effect.neutral)] if astray else []
    if _limits(effect) and promised >= MUCH_PROMISED and realised < HALF_REALISED * promised:
        nearer = [dict(other) for other in effect.starts]
    elif not astray and fitted.converged and still_promised(fitted) > STUCK:
        nearer = [dict(effect.neutral), *(dict(other) for other in effect.starts)]
    for other in (*nearer, *others):
        try:
            again = _fitted(current, windows, effect, other, min(hopeless, fitted.projected.objective))
        except BadInput:  # it diverges from there
            continue
        fitted = min(fitted, again, key=lambda one: one.projected.objective)
    while (wider := longer(effect, fitted, windows)) is not None:
        model = current.simulator.with_effect(wider)
        again = fit(model, windows, fitted.theta, current.projected.weight, fitted.lin.starts, hopeless)
        if again.projected.objective >= fitted.projected.objective:
            break
        fitted, effect = again, wider
    return fitted, effect


def _limits(effect: Effect) -> bool:
    """Whether the effect is a limit: it does nothing at its upper bound alone."""
    return effect.neutral[effect.magnitude] == effect.parameters[effect.magnitude].high


def _halved(effect: Effect, start: dict[str, float]) -> dict[str, float]:
    """The effect at half the size."""
    nothing = effect.neutral[effect.magnitude]
    return {**start, effect.magnitude: nothing + 0.5 * (start[effect.magnitude] - nothing)}


def _fitted(current: Fit, windows: Windows, effect: Effect, start: dict[str, float], hopeless: float) -> Fit:
    """The grown model fitted from one place."""
    own = [start[name] for name in effect_entries(current.simulator, effect).values()]
    theta = torch.cat([current.theta, current.theta.new_tensor(own)])
    model = current.simulator.with_effect(effect)
    return restart_inactive_effects(
        fit(model, windows, theta, current.projected.weight, current.lin.starts, hopeless), windows
    )
