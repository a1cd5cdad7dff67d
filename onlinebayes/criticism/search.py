"""The search for missing effects: settle, screen, judge, add the best, refit, try the earlier ones without, again.

This module owns the order only; every rule stands in the module that is called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.acceptance import Judged, choose, contained, interval
from onlinebayes.criticism.blocks import FEWEST, make_blocks
from onlinebayes.criticism.bounds import Widened, excluded
from onlinebayes.criticism.candidates import grown, propose
from onlinebayes.criticism.changes import Changed, changed
from onlinebayes.criticism.grid import row_step, run_grids
from onlinebayes.criticism.last import Group, instead, last_candidates, last_found
from onlinebayes.criticism.noise import floors
from onlinebayes.criticism.numerics import Grounds, settle
from onlinebayes.criticism.pairs import pair
from onlinebayes.criticism.projection import signal_rms
from onlinebayes.criticism.replaced import replaced
from onlinebayes.criticism.results import Selection
from onlinebayes.criticism.stage import Stage, blocks_for, run_stage
from onlinebayes.criticism.zeros import beside_zeros
from onlinebayes.measurements import Measurement
from onlinebayes.runs import Interrupt
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import Effect

MOST_EFFECTS = 6


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
    accepted: tuple[tuple[Stage, Judged], ...]
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
class _BeforeTrial:
    """The model before an effect was taken on trial; it comes back unless noise is all that is left."""

    current: Grounds
    accepted: list[tuple[Stage, Judged]]
    changes: list[Changed]


def ground(simulator: Simulator, measurement: Measurement, selection: Selection) -> Grounds:
    """The base model fitted, with the noise floor of the fit runs."""
    noise = floors(measurement.signals, run_grids(measurement, row_step(measurement)))
    return settle(simulator, measurement, selection.horizon_s, noise.to(measurement.data["signal"]))


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
        most: number of effects to add at most, one or more.
        say: takes one line of progress.
        interrupt: looked at between rounds and between the fits of a round.
        base: the base model on its grounds, where it was fitted already.
    """
    if base is None:
        say("fitting the base model")
        base = ground(simulator, measurement, selection)
    current = base
    effects = propose(base.fitted.simulator, base.windows, candidates)
    stages: list[Stage] = []
    accepted: list[tuple[Stage, Judged]] = []
    changes: list[Changed] = []
    last: tuple[Group, ...] = ()
    before: _BeforeTrial | None = None
    moves = bool(base.windows.observed.any())
    enough = moves and make_blocks(base.windows, 0.0, selection.folds).count >= FEWEST
    while enough and current.numerics.sufficient:
        if interrupt is not None and interrupt.requested:
            if before is not None and not _at_floor(current, selection.tolerance):
                current, accepted, changes = before.current, before.accepted, before.changes
            return Found(base, current, effects, tuple(stages), tuple(accepted), True, changes=tuple(changes))
        say(f"screening {len(effects) - len(accepted)} effects")
        present = {judged.effect.key for _, judged in accepted}
        present = present.union(*(contained(judged.effect) for _, judged in accepted))
        left = [effect for effect in effects if effect.key not in present]
        thorough = not stages and not _at_floor(current, selection.tolerance)
        stage = run_stage(current.fitted, current.windows, left, current.numerics, selection, say, thorough, interrupt)
        stages.append(stage)
        if interrupt is not None and interrupt.requested:
            continue  # a round that was cut short accepts nothing
        if thorough and (wide := excluded(simulator, measurement, selection, base, stage)) is not None:
            return Found(base, wide.grounds, effects, tuple(stages), (), widened=wide)
        chosen = _chosen(simulator, measurement, selection, current, stage, left, accepted, say, interrupt)
        if not chosen and interrupt is not None and interrupt.requested:
            continue
        if isinstance(chosen, Changed):
            say(f"giving every run its own {chosen.judged.address}")
            changes.append(chosen)
            simulator, current = chosen.simulator, chosen.grounds
            kept = _without_idle(simulator, measurement, selection, current, accepted, accepted)
            current, accepted = kept or (current, accepted)
            continue
        if not chosen and candidates == "all" and not last and not _at_floor(current, selection.tolerance):
            last = last_candidates(current, len(accepted))
            latest = last_found(current, last, selection, say, interrupt)
            if interrupt is not None and interrupt.requested and (latest is None or not latest.believed):
                continue
            if latest is not None:
                chosen = [(latest.stage, latest.judged)]
                before = None if latest.believed else _BeforeTrial(current, list(accepted), list(changes))
        if not chosen:
            break
        say(f"adding {' and '.join(judged.effect.key for _, judged in chosen)}")
        accepted += chosen
        current = _resettled(simulator, measurement, selection, current, chosen[-1][1], accepted)
        if (richer := replaced(simulator, measurement, selection, current, accepted)) is not None:
            say(f"{chosen[-1][1].effect.key} takes the place of what it contains")
            current, accepted = richer
        kept = _without_idle(simulator, measurement, selection, current, accepted, accepted[:-1])
        if kept is not None:
            current, accepted = kept
            break  # a round that takes away what an earlier one gave would only repeat itself
        if len(accepted) >= most:
            break
    if before is not None and not _at_floor(current, selection.tolerance):
        current, accepted, changes = before.current, before.accepted, before.changes
    quiet = candidates == "all" and not changes and _at_floor(current, selection.tolerance)
    if quiet and (one := instead(base, current, accepted, selection, say)) is not None:
        accepted = [one]
        current = _resettled(simulator, measurement, selection, current, one[1], accepted)
    tried = (*effects, *(effect for _, group in last for effect in group))
    return Found(base, current, tried, tuple(stages), tuple(accepted), enough=enough, changes=tuple(changes))


def _chosen(
    simulator: Simulator,
    measurement: Measurement,
    selection: Selection,
    current: Grounds,
    stage: Stage,
    left: Sequence[Effect],
    accepted: Sequence[tuple[Stage, Judged]],
    say: Callable[[str], None],
    interrupt: Interrupt | None,
) -> Changed | list[tuple[Stage, Judged]]:
    """What a round adds: a parameter that differs between runs, an effect, or two; nothing where nothing is admissible.

    A change that leaves noise goes before two effects, one that leaves more after them.
    """
    admissible = [judged for judged in stage.judged if judged.admissible]
    best = choose(admissible, current.windows.bin_step) if admissible else None
    if best is not None:
        stage = beside_zeros(stage, best, current.numerics, selection, say)
        admissible = [judged for judged in stage.judged if judged.admissible]
        best = choose(admissible, current.windows.bin_step)
    if best is None and _at_floor(current, selection.tolerance):
        return []
    effects = [judged.effect for _, judged in accepted]
    change = changed(simulator, measurement, selection, current, stage, effects, best)
    if change is not None and change.noise:
        return change
    added = [(stage, best)] if best else list(pair(stage, left, current.numerics, selection, say, interrupt) or ())
    return change if not added and change is not None and change.halved else added


def _at_floor(grounds: Grounds, tolerance: float) -> bool:
    """Whether the residual is the sensors' noise already, so that only a significant candidate is worth a refit."""
    return float(signal_rms(grounds.fitted.projected).max()) <= tolerance


def _resettled(
    simulator: Simulator,
    measurement: Measurement,
    selection: Selection,
    current: Grounds,
    best: Judged,
    accepted: Sequence[tuple[Stage, Judged]],
) -> Grounds:
    """The grown model, at a step that is fine enough for it."""
    model = grown(simulator, [judged.effect for _, judged in accepted])
    return settle(
        model,
        measurement,
        selection.horizon_s,
        current.windows.noise,
        best.fitted.theta,
        before=current,
        fitted=best.fitted,
    )


def _without_idle(
    simulator: Simulator,
    measurement: Measurement,
    selection: Selection,
    current: Grounds,
    accepted: list[tuple[Stage, Judged]],
    earlier: list[tuple[Stage, Judged]],
) -> tuple[Grounds, list[tuple[Stage, Judged]]] | None:
    """The model without an ``earlier`` effect that may now be nothing; None where all are needed."""
    blocks = blocks_for(current.fitted, current.windows, selection.folds)
    for idle in earlier:
        effect = idle[1].effect
        low, high = interval(current.fitted, blocks, effect)
        if low <= effect.neutral[effect.magnitude] <= high:
            kept = [item for item in accepted if item is not idle]
            model = grown(simulator, [judged.effect for _, judged in kept])
            theta = carried(current.fitted.simulator, current.fitted.theta, model)
            return settle(model, measurement, selection.horizon_s, current.windows.noise, theta, current), kept
    return None


def carried(source: Simulator, theta: Float[Tensor, " P"], target: Simulator) -> Float[Tensor, " Q"]:
    """Theta of ``target``: the values of ``source`` where it has the same parameter, else nominal ones."""
    values = dict(zip(source.parameters, theta.unbind(), strict=True))
    nominal = target.nominal.to(theta)
    rows = [values.get(name, nominal[i]) for i, name in enumerate(target.parameters)]
    return torch.stack(rows) if rows else nominal
