"""The search for missing effects: settle, screen, judge, add the best, refit, try the earlier ones without, again.

This module owns the order only; every rule stands in the module that is called.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.judging.acceptance import choose
from onlinebayes.criticism.searching.added_by_hand import begun_as_candidates
from onlinebayes.criticism.searching.backward_elimination import eliminate
from onlinebayes.criticism.searching.bounds import Widened, excluded
from onlinebayes.criticism.searching.changes import Changed, find_change
from onlinebayes.criticism.searching.confounded import merge_confounded
from onlinebayes.criticism.searching.contained_effects import drop_contained
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.flexible_candidates import (
    FlexibleFind,
    Group,
    best_of_groups,
    find_beside,
    flexible_groups,
    try_groups,
)
from onlinebayes.criticism.searching.one_for_several import put_one_for_several
from onlinebayes.criticism.searching.pairs import find_pair
from onlinebayes.criticism.searching.parsimony import simplify
from onlinebayes.criticism.searching.rival_swap import swap_in_better_rival
from onlinebayes.criticism.searching.sensor_zeros import judge_zero_errors
from onlinebayes.criticism.searching.shared_law import find_shared_law
from onlinebayes.criticism.searching.stage import Added, Stage, run_stage
from onlinebayes.criticism.searching.working_model import WorkingModel, drop_idle, with_change, with_effects
from onlinebayes.identification.data.noise import measured_floors
from onlinebayes.identification.fitting.blocks import FEWEST_BLOCKS, make_blocks
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

MOST_EFFECTS = 6
MOST_FLEXIBLE_TRIES = 2  # of what is tried last: two laws may hide each other


@dataclass(frozen=True)
class SearchResult:
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
    effects: tuple[Effect, ...] = ()
    stages: tuple[Stage, ...] = ()
    accepted: tuple[Added, ...] = ()
    interrupted: bool = False
    enough: bool = True
    widened: Widened | None = None
    changes: tuple[Changed, ...] = ()
    taken_back: tuple[Added, ...] = ()

    def simulator(self, base: Identifiable) -> Identifiable:
        """The base model at its own step, with a value in every run of what was found to differ between them."""
        return self.changes[-1].simulator if self.changes else base

    @property
    def undecided(self) -> bool:
        """Whether an effect of the last round failed for nothing but too few independent blocks."""
        return bool(self.stages) and any(judged.undecided for judged in self.stages[-1].judged)


def ground(simulator: Identifiable, measurement: Measurement, selection: Selection) -> Grounds:
    """The base model fitted, its own effects from where candidates begin, with the noise floor of the fit runs."""
    grounds = settle(simulator, measurement, selection.horizon_s, measured_floors(measurement))
    return begun_as_candidates(grounds, simulator, measurement, selection)


def enough_motion(base: Grounds, selection: Selection) -> bool:
    """Whether joints move, for as many blocks as it takes to tell a law from chance."""
    moves = bool(base.windows.observed.any())
    return moves and make_blocks(base.windows, 0.0, selection.folds).count >= FEWEST_BLOCKS


def search(simulator: Identifiable, context: SearchContext, most: int, base: Grounds | None = None) -> SearchResult:
    """Look for missing effects.

    Args:
        simulator: the base model at its own step.
        context: the fit runs, how effects are judged, which of them, and who watches.
        most: number of effects after which no round begins, one or more; the last round may add several at once.
        base: the base model on its grounds, where it was fitted already.
    """
    watch = context.watch
    if base is None:
        watch.say("fitting the base model")
        base = ground(simulator, context.measurement, context.selection)
    effects = propose(base.fitted.simulator, base.windows, context.candidates)
    if not enough_motion(base, context.selection):
        return SearchResult(base, base, effects, interrupted=watch.stopped, enough=False)
    running = _Search(context, simulator, base, effects, WorkingModel(simulator, base))
    widened: Widened | None = None
    with watch.giving_up():
        widened = running.go_round(most)
    if widened is not None:
        return SearchResult(base, widened.grounds, effects, tuple(running.stages), widened=widened)
    running.end_trial()
    if not watch.stopped:
        with watch.giving_up():
            running.simplify()
    return running.result()


@dataclass
class _Search:
    """A search under way. Its steps change it one by one, so that a stop in the middle of one leaves what was known.

    Args:
        context: of the search.
        simulator, base: the base model at its own step, and fitted.
        effects: the candidates.
        working: the model as it stands.
        stages: the rounds so far.
        seen: the effects that stood after each of them.
        flexible: what was tried last, each time.
        alone: of these, what was tried with nothing else in the model.
        before_trial: the model that comes back unless noise is all that is left.
        on_trial: what goes then.
    """

    context: SearchContext
    simulator: Identifiable
    base: Grounds
    effects: tuple[Effect, ...]
    working: WorkingModel
    stages: list[Stage] = field(default_factory=list)
    seen: set[frozenset[str]] = field(default_factory=set)
    flexible: list[tuple[Group, ...]] = field(default_factory=list)
    alone: set[str] = field(default_factory=set)
    before_trial: WorkingModel | None = None
    on_trial: tuple[Added, ...] = ()

    @property
    def at_floor(self) -> bool:
        """Whether the model as it stands leaves noise."""
        return self.working.at_floor(self.context.selection.tolerance)

    def go_round(self, most: int) -> Widened | None:
        """Round after round, until one adds nothing; a bound that excludes the truth, which is the answer then."""
        context, watch = self.context, self.context.watch
        while self.working.grounds.numerics.sufficient and not watch.stopped:
            thorough = not self.stages and not self.at_floor
            self.stages.append(_round(context, self.working, self.effects, thorough, len(self.stages) + 1))
            if watch.stopped:
                break  # a round that was cut short accepts nothing
            if thorough and (wide := excluded(self.simulator, context, self.base, self.stages[0])) is not None:
                return wide
            added = _chosen(context, self.working, self.stages[-1], self.effects)
            if isinstance(added, Changed):
                self.give_own_values(added)
            elif not self.take_in(added or self.try_flexible()) or self.is_full(most):
                break
        return None

    def give_own_values(self, change: Changed) -> None:
        """A parameter differs between runs from here on; what that makes needless goes."""
        self.context.watch.say(f"giving every run its own {change.judged.address}")
        self.working = with_change(self.working, change)
        self.working = drop_idle(self.working, self.working.accepted, self.context) or self.working

    def try_flexible(self) -> list[Added]:
        """What is found among the candidates of much freedom; on trial where it leaves more than noise."""
        if self.context.watch.stopped or self.at_floor or not self.context.everything:
            return []
        working, again = self.working, len(self.flexible) < MOST_FLEXIBLE_TRIES
        self.flexible.append(flexible_groups(working.grounds, working.effects) if again else ())
        if not (working.effects or working.changes):
            self.alone = {effect.key for _, group in self.flexible[-1] for effect in group}
        latest = _latest(self.context, working, self.stages[-1], self.flexible[-1])
        if latest is None:
            return []
        if self.before_trial is None and not latest.believed:
            self.before_trial, self.on_trial = working, tuple(latest.added)
        return latest.added

    def take_in(self, added: Sequence[Added]) -> bool:
        """Whether the model changes: by what was added or, where nothing was, by one effect in place of several."""
        if added:
            self.working = _extended(self.context, self.working, added)
            return True
        leaner = merge_confounded(self.working, self.stages[-1], self.context)
        self.working = leaner or self.working
        return leaner is not None

    def is_full(self, most: int) -> bool:
        """Whether no round follows: there are ``most`` effects, or those that stood before.

        What takes an earlier one's place may make room for others; the same ones again would go round in circles.
        """
        names = frozenset(effect.key for effect in self.working.effects)
        if names in self.seen or len(self.working.accepted) >= most:
            return True
        self.seen.add(names)
        return False

    def end_trial(self) -> None:
        """What stood on trial goes where more than noise is left, and is none of it otherwise."""
        if self.before_trial is not None and not self.at_floor:
            self.working = self.before_trial
        else:
            self.on_trial = ()

    def simplify(self) -> None:
        """The model without what it does not need, and with fewer effects where they explain as much."""
        self.working = eliminate(self.working, self.context)
        self.working = _simplest(self.context, self.base, self.working, self.alone)

    def result(self) -> SearchResult:
        """What was found."""
        working = self.working
        late = {effect.key: effect for groups in self.flexible for _, group in groups for effect in group}
        return SearchResult(
            self.base,
            working.grounds,
            (*self.effects, *late.values()),
            tuple(self.stages),
            working.accepted,
            interrupted=self.context.watch.stopped,
            changes=working.changes,
            taken_back=self.on_trial,
        )


def _round(
    context: SearchContext, working: WorkingModel, effects: Sequence[Effect], thorough: bool, number: int
) -> Stage:
    """Everything that is not in the model screened, and the leading ones judged."""
    grounds, left = working.grounds, working.untried(effects)
    context.watch.say(f"screening {len(left)} effects, round {number}")
    fitted, windows, numerics = grounds.fitted, grounds.windows, grounds.numerics
    return run_stage(fitted, windows, left, numerics, context.selection, context.watch, thorough)


def _chosen(
    context: SearchContext, working: WorkingModel, stage: Stage, effects: Sequence[Effect]
) -> Changed | list[Added]:
    """What a round adds: a parameter that differs between runs, or effects; nothing where nothing is admissible.

    One effect, or one law at several places, or two effects. A change that leaves noise goes before several effects,
    one that leaves more after them.
    """
    grounds = working.grounds
    admissible = [judged for judged in stage.judged if judged.admissible]
    best = choose(admissible, grounds.windows.bin_step) if admissible else None
    if best is not None:
        stage = judge_zero_errors(stage, best, grounds.numerics, context)
        admissible = [judged for judged in stage.judged if judged.admissible]
        best = choose(admissible, grounds.windows.bin_step)
    if best is None and working.at_floor(context.selection.tolerance):
        return []
    change = find_change(working.simulator, context, grounds, stage, working.effects, best)
    if change is not None and change.noise:
        return change
    if best is not None:
        return [(stage, best)]
    left = working.untried(effects)
    added = find_shared_law(stage, left, grounds.numerics, context)
    added = added or list(find_pair(stage, left, grounds.numerics, context) or ())
    return change if not added and change is not None and change.halved else added


def _latest(
    context: SearchContext, working: WorkingModel, stage: Stage, groups: Sequence[Group]
) -> FlexibleFind | None:
    """What is found among those that are tried last; nothing on trial where there is no time to go on from it."""
    grounds, selection, watch = working.grounds, context.selection, context.watch
    tried = try_groups(grounds, groups, context)
    latest = best_of_groups(grounds, tried, selection)
    if latest is None and not watch.stopped:
        latest = find_beside([stage, *tried], grounds, groups, context)
    return None if latest is None or (watch.stopped and not latest.believed) else latest


def _extended(context: SearchContext, working: WorkingModel, added: Sequence[Added]) -> WorkingModel:
    """The model with what a round added, what that tells from its rivals, without what it makes needless."""
    context.watch.say(f"adding {' and '.join(judged.effect.key for _, judged in added)}")
    working = with_effects(working, added, context)
    if (richer := drop_contained(working, context)) is not None:
        context.watch.say(f"{added[-1][1].effect.key} takes the place of what it contains")
        working = richer
    working = swap_in_better_rival(working, context) or working
    return drop_idle(working, working.accepted[:-1], context) or working


def _simplest(context: SearchContext, base: Grounds, working: WorkingModel, alone: set[str]) -> WorkingModel:
    """The model with fewer effects, or one in place of several, not one tried ``alone``, where they explain as much."""
    if context.watch.stopped or not working.at_floor(context.selection.tolerance):
        return working
    working = simplify(working, context)
    if working.changes or not context.everything:
        return working
    return put_one_for_several(base, working, context, alone) or working
