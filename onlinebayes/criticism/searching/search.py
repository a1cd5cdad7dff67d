"""The search for missing effects: settle, screen, judge, add the best, refit, try the earlier ones without, again.

This module owns the order only; every rule stands in the module that is called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.data.noise import measured_floors
from onlinebayes.criticism.fitting.blocks import FEWEST, make_blocks
from onlinebayes.criticism.fitting.numerics import Grounds, settle
from onlinebayes.criticism.judging.acceptance import choose
from onlinebayes.criticism.results import Selection
from onlinebayes.criticism.searching.bounds import Widened, excluded
from onlinebayes.criticism.searching.changes import Changed, changed
from onlinebayes.criticism.searching.family import family
from onlinebayes.criticism.searching.fewer import with_fewer
from onlinebayes.criticism.searching.last import (
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
from onlinebayes.criticism.searching.zeros import beside_zeros
from onlinebayes.measurements import Measurement
from onlinebayes.runs import Interrupt
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

    def simulator(self, base: Simulator) -> Simulator:
        """The base model at its own step, with a value in every run of what was found to differ between them."""
        return self.changes[-1].simulator if self.changes else base

    @property
    def undecided(self) -> bool:
        """Whether an effect of the last round failed for nothing but too few independent blocks."""
        return bool(self.stages) and any(judged.undecided for judged in self.stages[-1].judged)


@dataclass(frozen=True)
class _Asked:
    """What is the same in every round: the fit runs, how effects are judged, which of them, and whom to tell."""

    measurement: Measurement
    selection: Selection
    candidates: str | Sequence[str | Effect]
    say: Callable[[str], None]
    interrupt: Interrupt | None

    @property
    def stopped(self) -> bool:
        return self.interrupt is not None and self.interrupt.requested

    @property
    def fit_in_hand(self) -> AbstractContextManager[None]:
        """Where a second Ctrl-C gives up the fit that a first one waits for, and keeps what is known."""
        return nullcontext() if self.interrupt is None else self.interrupt.giving_up()

    @property
    def everything(self) -> bool:
        return self.candidates == "all"


def ground(simulator: Simulator, measurement: Measurement, selection: Selection) -> Grounds:
    """The base model fitted, with the noise floor of the fit runs."""
    return settle(simulator, measurement, selection.horizon_s, measured_floors(measurement))


def enough(base: Grounds, selection: Selection) -> bool:
    """Whether joints move, for as many blocks as it takes to tell a law from chance."""
    moves = bool(base.windows.observed.any())
    return moves and make_blocks(base.windows, 0.0, selection.folds).count >= FEWEST


def search(
    simulator: Simulator,
    measurement: Measurement,
    selection: Selection,
    candidates: str | Sequence[str | Effect],
    most: int,
    say: Callable[[str], None],
    interrupt: Interrupt | None,
    base: Grounds | None = None,
) -> Found:
    """Look for missing effects.

    Args:
        simulator: the base model at its own step.
        measurement: the fit runs.
        selection: how effects are judged.
        candidates: which effects to try (see :func:`propose`).
        most: number of effects after which no round begins, one or more; the last round may add several at once.
        say: takes one line of progress.
        interrupt: looked at between rounds and between the fits of a round.
        base: the base model on its grounds, where it was fitted already.
    """
    if base is None:
        say("fitting the base model")
        base = ground(simulator, measurement, selection)
    asked = _Asked(measurement, selection, candidates, say, interrupt)
    effects = propose(base.fitted.simulator, base.windows, candidates)
    if not enough(base, selection):
        return Found(base, base, effects, (), (), asked.stopped, enough=False)
    standing = Standing(simulator, base)
    stages: list[Stage] = []
    seen: set[frozenset[str]] = set()
    last: list[tuple[Group, ...]] = []  # of what is tried last, each time
    before_trial: Standing | None = None  # comes back unless noise is all that is left
    with asked.fit_in_hand:
        while standing.grounds.numerics.sufficient and not asked.stopped:
            thorough = not stages and not standing.at_floor(selection.tolerance)
            stages.append(_round(asked, standing, effects, thorough, len(stages) + 1))
            if asked.stopped:
                break  # a round that was cut short accepts nothing
            if thorough and (wide := excluded(simulator, measurement, selection, base, stages[0])) is not None:
                return Found(base, wide.grounds, effects, tuple(stages), (), widened=wide)
            added = _chosen(asked, standing, stages[-1], effects)
            if isinstance(added, Changed):
                say(f"giving every run its own {added.judged.address}")
                standing = with_change(standing, added)
                standing = without_idle(standing, standing.accepted, measurement, selection) or standing
                continue
            if not (added or asked.stopped or standing.at_floor(selection.tolerance)) and asked.everything:
                last.append(last_candidates(standing.grounds, standing.effects) if len(last) < MOST_LAST else ())
                if (latest := _latest(asked, standing, stages[-1], last[-1])) is not None:
                    added = latest.added
                    before_trial = before_trial or (None if latest.believed else standing)
            if not added:
                break
            standing = _extended(asked, standing, added)
            names = frozenset(effect.key for effect in standing.effects)
            # What takes an earlier one's place may make room for others; the same ones again would go round in circles.
            if names in seen or len(standing.accepted) >= most:
                break
            seen.add(names)
    if before_trial is not None and not standing.at_floor(selection.tolerance):
        standing = before_trial
    if not asked.stopped:
        standing = _simplest(asked, base, without_needless(standing, measurement, selection))
    late = {effect.key: effect for groups in last for _, group in groups for effect in group}
    tried = (*effects, *late.values())
    accepted, changes = standing.accepted, standing.changes
    return Found(base, standing.grounds, tried, tuple(stages), accepted, asked.stopped, changes=changes)


def _round(asked: _Asked, standing: Standing, effects: Sequence[Effect], thorough: bool, number: int) -> Stage:
    """Everything that is not in the model screened, and the leading ones judged."""
    grounds, left = standing.grounds, standing.untried(effects)
    asked.say(f"screening {len(left)} effects, round {number}")
    fitted, windows, numerics = grounds.fitted, grounds.windows, grounds.numerics
    return run_stage(fitted, windows, left, numerics, asked.selection, asked.say, thorough, asked.interrupt)


def _chosen(asked: _Asked, standing: Standing, stage: Stage, effects: Sequence[Effect]) -> Changed | list[Added]:
    """What a round adds: a parameter that differs between runs, or effects; nothing where nothing is admissible.

    One effect, or one law at several places, or two effects. A change that leaves noise goes before several effects,
    one that leaves more after them.
    """
    selection, say, grounds = asked.selection, asked.say, standing.grounds
    admissible = [judged for judged in stage.judged if judged.admissible]
    best = choose(admissible, grounds.windows.bin_step) if admissible else None
    if best is not None:
        stage = beside_zeros(stage, best, grounds.numerics, selection, say)
        admissible = [judged for judged in stage.judged if judged.admissible]
        best = choose(admissible, grounds.windows.bin_step)
    if best is None and standing.at_floor(selection.tolerance):
        return []
    change = changed(standing.simulator, asked.measurement, selection, grounds, stage, standing.effects, best)
    if change is not None and change.noise:
        return change
    if best is not None:
        return [(stage, best)]
    left = standing.untried(effects)
    added = family(stage, left, grounds.numerics, selection, say, asked.interrupt)
    added = added or list(pair(stage, left, grounds.numerics, selection, say, asked.interrupt) or ())
    return change if not added and change is not None and change.halved else added


def _latest(asked: _Asked, standing: Standing, stage: Stage, groups: Sequence[Group]) -> Last | None:
    """What is found among those that are tried last; nothing on trial where there is no time to go on from it."""
    grounds, selection, say, interrupt = standing.grounds, asked.selection, asked.say, asked.interrupt
    tried = tried_last(grounds, groups, selection, say, interrupt)
    latest = last_found(grounds, tried, selection)
    if latest is None and not asked.stopped:
        latest = found_beside([stage, *tried], grounds, groups, selection, say, interrupt)
    return None if latest is None or (asked.stopped and not latest.believed) else latest


def _extended(asked: _Asked, standing: Standing, added: Sequence[Added]) -> Standing:
    """The model with what a round added, without what that makes needless."""
    asked.say(f"adding {' and '.join(judged.effect.key for _, judged in added)}")
    standing = with_effects(standing, added, asked.measurement, asked.selection)
    if (richer := replaced(standing, asked.measurement, asked.selection)) is not None:
        asked.say(f"{added[-1][1].effect.key} takes the place of what it contains")
        standing = richer
    return without_idle(standing, standing.accepted[:-1], asked.measurement, asked.selection) or standing


def _simplest(asked: _Asked, base: Grounds, standing: Standing) -> Standing:
    """The model with fewer effects, or one in place of several, where they explain as much."""
    if asked.stopped or not standing.at_floor(asked.selection.tolerance):
        return standing
    standing = with_fewer(standing, asked.measurement, asked.selection, asked.say, asked.interrupt)
    if standing.changes or not asked.everything:
        return standing
    one = instead(base, standing.grounds, standing.accepted, asked.selection, asked.say)
    return standing if one is None else with_effects(standing, [one], asked.measurement, asked.selection, alone=True)
