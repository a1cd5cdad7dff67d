"""Candidates with so much freedom that they find something in whatever another law leaves: tried last, and strictly.

Cogging with its period and phase, wind with the drag that it needs, and of each free parameter a ``parameter_drift``
and a ``parameter_step`` with a number for every instant. They come where no effect and no change between runs was
found, one group after another, and one is believed only where it leaves no more than noise. What changes in time is
asked after the others.

The level is half of what is usual, shared out among the groups where little is wrong: by chance something might do.
Nothing leaves noise of a gross misfit by chance, so that each has it whole there; and whatever screening's p, those
that promise most are refitted, for each sign flip of a residual that holds a wave excites a wave of another phase, too.

Where another effect is missing beside it, one may leave more than noise: it is taken on trial if it takes away 30 % of
the error (two laws that hide each other take little each: of a late motor's cogging 40 % were seen). Where effects were
found and a thousand floors are left, none of these will leave noise, and they are not tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from onlinebayes.criticism.candidates.candidates import can_have, propose
from onlinebayes.criticism.candidates.survey import survey
from onlinebayes.criticism.judging.acceptance import Judged, choose
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.per_run_parameters import HALF_LEVEL, may_change
from onlinebayes.criticism.searching.stage import (
    EVERY_P,
    GROSS_FLOORS,
    HOPELESS_RATIO,
    LEAST_PROMISE_OF_GROSS,
    MOST_FLOORS,
    REFIT_BELOW,
    Added,
    Stage,
    judged_stage,
    leaves_noise,
    worth,
)
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.identification.results import Selection
from onlinebayes.simulators.effects import EFFECTS, Effect, ParameterDrift, ParameterStep

MOST_REFITS_OF_A_GROUP = 2
"""So many candidates of one group are refitted at most."""

RUGGED = 0.5
"""Part of the usual promise that a rugged effect needs: between two values of its grid it promises less than it has."""

MOST_LEADS = 3
"""Beside so many candidates that were not admissible alone those that are tried last are looked for."""

LEAST_FALL_ON_TRIAL = 0.3
"""What lowers a gross error by this share is taken on trial though it leaves more than noise."""

CREEPING_ABOVE = 0.7
"""Of a gross misfit's squared error: a fit that creeps above it is given up, for half is what a trial asks."""

Group = tuple[str, tuple[Effect, ...]]


@dataclass(frozen=True)
class FlexibleFind:
    """What was found among the flexible candidates.

    Args:
        stage, judged: the round that found it, and its judgement.
        believed: whether it leaves noise; if not, it stands on trial until all that is accepted after it does.
        lead: what it was found beside, which was not admissible alone.
    """

    stage: Stage
    judged: Judged
    believed: bool
    lead: Added | None = None

    @property
    def added(self) -> list[Added]:
        """What enters, in order."""
        return [*([] if self.lead is None else [self.lead]), (self.stage, self.judged)]


def flexible_groups(current: Grounds, found: Sequence[Effect] = ()) -> tuple[Group, ...]:
    """What is left to try beyond all and ``found``, in groups, each with what is being looked for."""
    if found and misfit(current.fitted.projected) > MOST_FLOORS:
        return ()
    return _without((*effect_groups(current), *_in_time(current)), {effect.key for effect in found})


def _without(groups: Sequence[Group], keys: set[str]) -> tuple[Group, ...]:
    """The groups without these effects."""
    left = ((what, tuple(effect for effect in effects if effect.key not in keys)) for what, effects in groups)
    return tuple((what, effects) for what, effects in left if effects)


def effect_groups(current: Grounds) -> Iterator[Group]:
    """The vocabulary's effects that are not among all, a group a name."""
    simulator, windows = current.fitted.simulator, current.windows
    for name, kind in {**EFFECTS, **simulator.own_effects}.items():
        if kind.tried_last and kind.target_kind != "parameter":
            yield f"for {name}", tuple(e for e in propose(simulator, windows, [name]) if can_have(simulator, e))


def _in_time(current: Grounds) -> Iterator[Group]:
    """A drift and a step of every free parameter that is no effect's and no constant of nature.

    A step may be at any of many instants: all parameters at once would fill the memory.
    """
    simulator, windows = current.fitted.simulator, current.windows
    for name in simulator.targets("parameter"):
        if may_change(name) and name in simulator.parameters:
            kinds = (ParameterDrift, ParameterStep)
            yield f"for changes of {name} in time", propose(simulator, windows, [f"{k.name}@{name}" for k in kinds])


def try_groups(
    current: Grounds,
    groups: Sequence[Group],
    context: SearchContext,
    hopeless: float = math.inf,
) -> list[Stage]:
    """Each group's round, until one explains all that a number for every instant could.

    Args:
        current: the model as it stands.
        groups: of :func:`flexible_groups`.
        context: of the search; its watch is looked at between the fits, and what was tried until then is returned.
        hopeless: an objective above which a fit that creeps is given up; of a gross misfit any that hardly falls.
    """
    selection, watch = context.selection, context.watch
    gross = misfit(current.fitted.projected) > GROSS_FLOORS
    if gross:
        hopeless = min(hopeless, CREEPING_ABOVE * current.fitted.projected.objective)
    level = HALF_LEVEL * selection.alpha / (1 if gross else max(len(groups), 1))
    stricter = replace(selection, alpha=level)
    tried: list[Stage] = []
    for what, effects in groups:
        if watch.stopped:
            break
        found = best_of_groups(current, tried, selection)
        if effects[0].target_kind == "parameter" and found is not None and found.believed:
            break  # an effect that explains all goes before a number for every instant
        watch.say(f"looking {what}")
        screened = survey(current.fitted, current.windows, effects, selection.folds)
        promising = [one for one in worth(screened, level, EVERY_P) if one.promise >= _least_promise(one.effect)]
        refits = promising if gross else worth(screened, level, REFIT_BELOW)
        most = refits[:MOST_REFITS_OF_A_GROUP]
        tried.append(judged_stage(screened, most, current.numerics, stricter, watch, hopeless))
    return tried


def _least_promise(effect: Effect) -> float:
    """What a candidate must promise of a gross misfit."""
    return LEAST_PROMISE_OF_GROSS * (RUGGED if effect.rugged else 1.0)


def best_of_groups(current: Grounds, tried: Sequence[Stage], selection: Selection) -> FlexibleFind | None:
    """The best of those that leave noise, or of those that take 30 % of a gross misfit; None without any.

    Args:
        current: the model as it stands.
        tried: of :func:`try_groups`.
        selection: how effects are judged.
    """
    gross = misfit(current.fitted.projected) > GROSS_FLOORS
    found: list[FlexibleFind] = []
    for stage in tried:
        admissible = [judged for judged in stage.judged if judged.admissible]
        quiet = [judged for judged in admissible if leaves_noise(judged.fitted, current.windows, selection.tolerance)]
        lowering = [judged for judged in admissible if gross and judged.falls[0] >= LEAST_FALL_ON_TRIAL]
        if quiet or lowering:
            found.append(FlexibleFind(stage, choose(quiet or lowering, current.windows.bin_step), bool(quiet)))
    return max(found, key=lambda find: (find.believed, find.judged.gain.gain), default=None)


def find_beside(
    tried: Sequence[Stage],
    current: Grounds,
    groups: Sequence[Group],
    context: SearchContext,
) -> FlexibleFind | None:
    """What leaves noise beside one of the significant candidates that fail fewest rules, where none was admissible.

    A late motor and cogging hide each other: neither lowers a gross misfit by much, and what gains most may be neither
    (of a dead zone and cogging it was a Stribeck curve). Whether the candidate is needed beside what was found is asked
    at the end, as of every effect (see :mod:`.backward_elimination`).

    Args:
        tried: the rounds.
        current, groups, context: as of :func:`try_groups`.
    """
    leads = [(stage, judged) for stage in tried for judged in stage.judged if judged.p_value < context.selection.alpha]
    if not (groups and leads) or misfit(current.fitted.projected) <= GROSS_FLOORS:
        return None
    for lead in _nearest(leads):
        context.watch.say(f"looking beside {lead[1].effect.key}")
        beside = replace(current, fitted=lead[1].fitted)
        others = _without(groups, {lead[1].effect.key})
        tried_beside = try_groups(beside, others, context, _noise(lead[1].fitted, context.selection))
        found = best_of_groups(beside, tried_beside, context.selection)
        if found is not None and found.believed:
            return replace(found, lead=lead)
        if context.watch.stopped:
            break
    return None


def _noise(fitted: Fit, selection: Selection) -> float:
    """The objective above which a fit that creeps will not leave noise."""
    share = selection.tolerance / misfit(fitted.projected)
    return HOPELESS_RATIO * share**2 * fitted.projected.objective


def _nearest(leads: Sequence[Added]) -> list[Added]:
    """The leads that fail fewest rules, of these the ones that gain most, each effect once."""
    best: dict[str, Added] = {}
    for lead in sorted(leads, key=lambda added: (len(added[1].failed), -added[1].gain.gain)):
        best.setdefault(lead[1].effect.key, lead)
    return list(best.values())[:MOST_LEADS]
