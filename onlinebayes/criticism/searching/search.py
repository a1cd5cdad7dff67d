"""The search for missing effects: settle, screen, judge, add the best, refit, try the earlier ones without, again.

This module owns the order only; every rule stands in the module that is called.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.data.noise import measured_floors
from onlinebayes.criticism.fitting.blocks import FEWEST_BLOCKS, make_blocks
from onlinebayes.criticism.fitting.numerics import Grounds, settle
from onlinebayes.criticism.judging.acceptance import choose
from onlinebayes.criticism.results import Selection
from onlinebayes.criticism.searching.added_by_hand import begun_as_candidates
from onlinebayes.criticism.searching.bounds import Widened, excluded
from onlinebayes.criticism.searching.changes import Changed, changed
from onlinebayes.criticism.searching.confounded import with_one_for_several
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.family import family
from onlinebayes.criticism.searching.fewer import with_fewer
from onlinebayes.criticism.searching.flexible_candidates import (
    Group,
    Last,
    found_beside,
    instead,
    last_candidates,
    last_found,
    tried_last,
)
from onlinebayes.criticism.searching.needless import without_needless
from onlinebayes.criticism.searching.pairs import pair
from onlinebayes.criticism.searching.replaced import replaced
from onlinebayes.criticism.searching.stage import Added, Stage, run_stage
from onlinebayes.criticism.searching.standing import Standing, with_change, with_effects, without_idle
from onlinebayes.criticism.searching.swapped import swapped
from onlinebayes.criticism.searching.zeros import beside_zeros
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Effect

MOST_EFFECTS = 6
MOST_LAST = 2  # of what is tried last: two laws may hide each other


@dataclass(frozen=True)
class Found:
    """What the search found.

    Args:
        base, final: the base model and the accepted one, fitted.
        effects: the candidates.
        stages: every round, the last one without an acceptance unless it was interrupted or only one was asked for.
        accepted: the effects that stand in the final model, with the judgement of the round that added them.
        interrupted: whether it was stopped.
        enough: whether there is enough motion to judge by: 7 windows' worth.
        widened: the bound that excludes the truth; ``final`` is then the base model with that bound widened.
        changes: the parameters that were given one value a run, in order.
        taken_back: what stood on trial and went, for more than noise was left beside it.
    """

    base: Grounds
    final: Grounds
    effects: tuple[Effect, ...]
    stages: tuple[Stage, ...]
    accepted: tuple[Added, ...]
    interrupted: bool = False
    enough: bool = True
    widened: Widened | None = None
    changes: tuple[Changed, ...] = ()
    taken_back: tuple[Added, ...] = ()

    def simulator(self, base: Simulator) -> Simulator:
        """The base model at its own step, with a value in every run of what was found to differ between them."""
        return self.changes[-1].simulator if self.changes else base

    @property
    def undecided(self) -> bool:
        """Whether an effect of the last round failed for nothing but too few independent blocks."""
        return bool(self.stages) and any(judged.undecided for judged in self.stages[-1].judged)


def ground(simulator: Simulator, measurement: Measurement, selection: Selection) -> Grounds:
    """The base model fitted, its own effects from where candidates begin, with the noise floor of the fit runs."""
    grounds = settle(simulator, measurement, selection.horizon_s, measured_floors(measurement))
    return begun_as_candidates(grounds, simulator, measurement, selection)


def enough_motion(base: Grounds, selection: Selection) -> bool:
    """Whether joints move, for as many blocks as it takes to tell a law from chance."""
    moves = bool(base.windows.observed.any())
    return moves and make_blocks(base.windows, 0.0, selection.folds).count >= FEWEST_BLOCKS


def search(simulator: Simulator, context: SearchContext, most: int, base: Grounds | None = None) -> Found:
    """Look for missing effects.

    Args:
        simulator: the base model at its own step.
        context: the fit runs, how effects are judged, which of them, and who watches.
        most: number of effects after which no round begins, one or more; the last round may add several at once.
        base: the base model on its grounds, where it was fitted already.
    """
    selection, watch = context.selection, context.watch
    if base is None:
        watch.say("fitting the base model")
        base = ground(simulator, context.measurement, selection)
    effects = propose(base.fitted.simulator, base.windows, context.candidates)
    if not enough_motion(base, selection):
        return Found(base, base, effects, (), (), watch.stopped, enough=False)
    standing = Standing(simulator, base)
    stages: list[Stage] = []
    seen: set[frozenset[str]] = set()
    last: list[tuple[Group, ...]] = []  # of what is tried last, each time
    alone: set[str] = set()  # of these, what was tried with nothing else
    before_trial: Standing | None = None  # comes back unless noise is all that is left
    on_trial: tuple[Added, ...] = ()
    with watch.giving_up():
        while standing.grounds.numerics.sufficient and not watch.stopped:
            thorough = not stages and not standing.at_floor(selection.tolerance)
            stages.append(_round(context, standing, effects, thorough, len(stages) + 1))
            if watch.stopped:
                break  # a round that was cut short accepts nothing
            if thorough and (wide := excluded(simulator, context, base, stages[0])) is not None:
                return Found(base, wide.grounds, effects, tuple(stages), (), widened=wide)
            added = _chosen(context, standing, stages[-1], effects)
            if isinstance(added, Changed):
                watch.say(f"giving every run its own {added.judged.address}")
                standing = with_change(standing, added)
                standing = without_idle(standing, standing.accepted, context) or standing
                continue
            if not (added or watch.stopped or standing.at_floor(selection.tolerance)) and context.everything:
                last.append(last_candidates(standing.grounds, standing.effects) if len(last) < MOST_LAST else ())
                if not (standing.effects or standing.changes):
                    alone = {effect.key for _, group in last[-1] for effect in group}
                if (latest := _latest(context, standing, stages[-1], last[-1])) is not None:
                    added = latest.added
                    if before_trial is None and not latest.believed:
                        before_trial, on_trial = standing, tuple(added)
            if added:
                standing = _extended(context, standing, added)
            elif (leaner := with_one_for_several(standing, stages[-1], context)) is not None:
                standing = leaner
            else:
                break
            names = frozenset(effect.key for effect in standing.effects)
            # What takes an earlier one's place may make room for others; the same ones again would go round in circles.
            if names in seen or len(standing.accepted) >= most:
                break
            seen.add(names)
    if before_trial is not None and not standing.at_floor(selection.tolerance):
        standing = before_trial
    else:
        on_trial = ()
    if not watch.stopped:
        with watch.giving_up():
            standing = without_needless(standing, context)
            standing = _simplest(context, base, standing, alone)
    late = {effect.key: effect for groups in last for _, group in groups for effect in group}
    tried = (*effects, *late.values())
    accepted, changes = standing.accepted, standing.changes
    stopped = watch.stopped
    return Found(base, standing.grounds, tried, tuple(stages), accepted, stopped, changes=changes, taken_back=on_trial)


def _round(context: SearchContext, standing: Standing, effects: Sequence[Effect], thorough: bool, number: int) -> Stage:
    """Everything that is not in the model screened, and the leading ones judged."""
    grounds, left = standing.grounds, standing.untried(effects)
    context.watch.say(f"screening {len(left)} effects, round {number}")
    fitted, windows, numerics = grounds.fitted, grounds.windows, grounds.numerics
    return run_stage(fitted, windows, left, numerics, context.selection, context.watch, thorough)


def _chosen(
    context: SearchContext, standing: Standing, stage: Stage, effects: Sequence[Effect]
) -> Changed | list[Added]:
    """What a round adds: a parameter that differs between runs, or effects; nothing where nothing is admissible.

    One effect, or one law at several places, or two effects. A change that leaves noise goes before several effects,
    one that leaves more after them.
    """
    grounds = standing.grounds
    admissible = [judged for judged in stage.judged if judged.admissible]
    best = choose(admissible, grounds.windows.bin_step) if admissible else None
    if best is not None:
        stage = beside_zeros(stage, best, grounds.numerics, context)
        admissible = [judged for judged in stage.judged if judged.admissible]
        best = choose(admissible, grounds.windows.bin_step)
    if best is None and standing.at_floor(context.selection.tolerance):
        return []
    change = changed(standing.simulator, context, grounds, stage, standing.effects, best)
    if change is not None and change.noise:
        return change
    if best is not None:
        return [(stage, best)]
    left = standing.untried(effects)
    added = family(stage, left, grounds.numerics, context)
    added = added or list(pair(stage, left, grounds.numerics, context) or ())
    return change if not added and change is not None and change.halved else added


def _latest(context: SearchContext, standing: Standing, stage: Stage, groups: Sequence[Group]) -> Last | None:
    """What is found among those that are tried last; nothing on trial where there is no time to go on from it."""
    grounds, selection, watch = standing.grounds, context.selection, context.watch
    tried = tried_last(grounds, groups, context)
    latest = last_found(grounds, tried, selection)
    if latest is None and not watch.stopped:
        latest = found_beside([stage, *tried], grounds, groups, context)
    return None if latest is None or (watch.stopped and not latest.believed) else latest


def _extended(context: SearchContext, standing: Standing, added: Sequence[Added]) -> Standing:
    """The model with what a round added, what that tells from its rivals, without what it makes needless."""
    context.watch.say(f"adding {' and '.join(judged.effect.key for _, judged in added)}")
    standing = with_effects(standing, added, context)
    if (richer := replaced(standing, context)) is not None:
        context.watch.say(f"{added[-1][1].effect.key} takes the place of what it contains")
        standing = richer
    standing = swapped(standing, context) or standing
    return without_idle(standing, standing.accepted[:-1], context) or standing


def _simplest(context: SearchContext, base: Grounds, standing: Standing, alone: set[str]) -> Standing:
    """The model with fewer effects, or one in place of several, not one tried ``alone``, where they explain as much."""
    if context.watch.stopped or not standing.at_floor(context.selection.tolerance):
        return standing
    standing = with_fewer(standing, context)
    if standing.changes or not context.everything:
        return standing
    one = instead(base, standing.grounds, standing.accepted, context, alone)
    return standing if one is None else with_effects(standing, [one], context, alone=True)
