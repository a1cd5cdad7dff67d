"""Every candidate screened against the current model: what a round does before it refits any.

Where the current residual is correlated for so long that it leaves fewer than 7 independent parts, the misfit itself
may be what is slow: it is taken as uncorrelated then, and a round asks of its candidates that what they leave is quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.candidates.candidates import Trial, grown, grown_theta, opposites, trials
from onlinebayes.criticism.candidates.cheaper_method import by_cheaper_method
from onlinebayes.criticism.candidates.exclusion import exclusion_limit
from onlinebayes.criticism.judging.score import SHORT_WINDOWS, CrossValidated, cross_validate
from onlinebayes.criticism.judging.screening import Column, Scores, block_scores, observed, p_values, promise
from onlinebayes.criticism.results import MOVES_NOTHING
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import (
    FEWEST_BLOCKS,
    Blocks,
    flip_groups,
    independent_parts,
    make_blocks,
)
from onlinebayes.identification.fitting.fit import Fit, residual_correlation_time
from onlinebayes.identification.fitting.projection import noise_rows, per_noise, project
from onlinebayes.identification.fitting.sensitivities import columns
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.replaying.timed import instants
from onlinebayes.simulators.effects import Effect

MORE_STARTS = 4
"""From which a rugged effect's refit begins again."""
STILL = 1e-7
"""Noise, over all bins together: a column below it is the engine's rounding."""


@dataclass(frozen=True)
class Screened:
    """One candidate after screening.

    Args:
        effect: the effect.
        z, p_value: of the maximum test; None where it is confounded.
        start: values from which its refit begins, short name -> value [SI].
        others: of a rugged effect, where it begins again: its next best starting values.
        promise: share by which it would lower the RMS, to first order.
        confounded_with: free parameters that do the same already.
        exclusion_limit: size of the first parameter, from neutral, that these data would have shown [SI].
    """

    effect: Effect
    z: float | None
    p_value: float | None
    start: dict[str, float]
    promise: float
    confounded_with: tuple[str, ...]
    exclusion_limit: float | None
    others: tuple[dict[str, float], ...] = ()


@dataclass(frozen=True)
class Survey:
    """The current model with all candidates screened, before any is refitted.

    Args:
        current, windows: the model, and what it was fitted on.
        blocks, slow: its blocks, and whether its residual is too slow to tell how much is independent.
        scores: its cross-validation.
        screened: the candidates, best first.
    """

    current: Fit
    windows: Windows
    blocks: Blocks
    slow: bool
    scores: CrossValidated
    screened: tuple[Screened, ...]


def survey(current: Fit, windows: Windows, effects: Sequence[Effect], folds: int | None) -> Survey:
    """Screen all effects against the current model."""
    correlation = residual_correlation_time(current, windows)
    if slow := independent_parts(windows, correlation, folds) < FEWEST_BLOCKS:
        correlation = 0.0
    blocks = make_blocks(windows, correlation, folds)
    scores = cross_validate(current, windows, blocks)
    cheaper = by_cheaper_method(current, windows, len(trials(effects)))
    screened = screen(cheaper, windows, effects, flip_groups(windows, correlation))
    return Survey(current, windows, blocks, slow, scores, screened)


def screen(
    current: Fit, windows: Windows, effects: Sequence[Effect], groups: Int[Tensor, " W"]
) -> tuple[Screened, ...]:
    """z and p of every effect, by the fit's own method; the confounded ones last. ``groups`` flip together."""
    if not effects:
        return ()
    in_all_runs = trials(effects)
    horizons, raw, tried = _sensitivities(current, windows, groups, effects, in_all_runs)
    tests = [Column(trial.candidate, trial.two_sided) for trial in tried]
    z, p, best = p_values(horizons, tests, len(effects))
    by_column = observed(horizons, tests)
    found = []
    for k, effect in enumerate(effects):
        if int(best[k]) < 0:
            mine = next(i for i, trial in enumerate(tried) if trial.candidate == k)
            found.append(Screened(effect, None, None, {}, 0.0, _confounding(current, windows, raw[mine]), None))
            continue
        i = int(best[k])
        own = [c for c, trial in enumerate(in_all_runs) if trial.candidate == k]
        starts = [
            starting_values(effect, tried[c], float(horizons[0].size[c]))
            for c in by_column.argsort(descending=True).tolist()
            if tried[c].candidate == k and c != i and by_column[c] > 0
        ]
        found.append(
            Screened(
                effect,
                float(z[k]),
                float(p[k]),
                starting_values(effect, tried[i], float(horizons[0].size[i])),
                promise(horizons, i),
                (),
                exclusion_limit(horizons[0], int(groups.max()) + 1, effect, own, tried),
                tuple(starts[:MORE_STARTS]) if effect.rugged else (),
            )
        )
    return tuple(sorted(found, key=lambda s: (s.p_value is None, s.p_value, -(s.z or 0.0))))


def _sensitivities(
    current: Fit, windows: Windows, groups: Int[Tensor, " W"], effects: Sequence[Effect], tried: tuple[Trial, ...]
) -> tuple[list[Scores], Float[Tensor, "C W n S"], tuple[Trial, ...]]:
    raw = _moving(windows, trial_columns(current, windows, effects, tried))
    if isinstance(current.simulator, ScopedSimulator):
        raw, tried = _run_by_run(current.simulator, windows, groups, effects, raw, tried)
    horizons = []
    for pieces in (1, SHORT_WINDOWS):
        projected = project(windows, current.lin, current.projected.weight, pieces)
        c = projected.project(noise_rows(windows, raw.movedim(0, -1), pieces))
        horizons.append(block_scores(projected, c, groups.repeat_interleave(pieces), int(groups.max()) + 1))
    return horizons, raw, tried


def _moving(windows: Windows, raw: Float[Tensor, "C W n S"]) -> Float[Tensor, "C W n S"]:
    """The columns, 0 where one is rounding: tests are blind to scale, and would take that for an effect."""
    still = ~((raw * per_noise(windows)).flatten(1).norm(dim=1) > STILL)
    return raw.index_fill(0, still.nonzero()[:, 0], 0.0)


def _run_by_run(
    simulator: ScopedSimulator,
    windows: Windows,
    groups: Int[Tensor, " W"],
    effects: Sequence[Effect],
    raw: Float[Tensor, "C W n S"],
    tried: tuple[Trial, ...],
) -> tuple[Float[Tensor, "D W n S"], tuple[Trial, ...]]:
    """Besides, an effect of one size a run in each run alone: sizes of either sign may cancel in all together.

    Only in runs of 7 groups at least: one of g groups keeps its signs in 2^-g of the flips, so that a smaller run could
    never be significant, and would only stand in the way of all together.
    """
    own = [k for k, t in enumerate(tried) if _owned(simulator, effects[t.candidate])]
    owner = simulator.owner_of(windows)
    masks = [owner == who for who in range(len(simulator.owners))]
    masks = [mask for mask in masks if len(torch.unique(groups[mask])) >= FEWEST_BLOCKS]
    alone = [raw[own] * mask.to(raw)[:, None, None] for mask in masks]
    return torch.cat([raw, *alone]), (*tried, *(tried[k] for _ in masks for k in own))


def _owned(simulator: ScopedSimulator, effect: Effect) -> bool:
    return simulator.scope.owned(f"{effect.key}.{effect.magnitude}")


def trial_columns(
    current: Fit, windows: Windows, effects: Sequence[Effect], tried: Sequence[Trial]
) -> Float[Tensor, "C W n S"]:
    """How the binned replay moves under each trial; 0 where a world diverged.

    Candidates are grown together in groups that cost the same: those that MuJoCo carries inside the engine, those that
    make it walk timestep by timestep, and those whose hidden states remember equally long.
    """
    groups: dict[tuple[bool, float], list[int]] = {}
    known = _in_time(current, windows, effects, tried)
    for k, effect in enumerate(effects):
        if k not in {tried[i].candidate for i in known}:
            groups.setdefault((effect.staged, effect.memory), []).append(k)
    mirrors = opposites(effects, tried)
    found: dict[int, Tensor] = {**known}
    for members in groups.values():
        group = [effects[k] for k in members]
        mine = [i for i, trial in enumerate(tried) if trial.candidate in members and i not in mirrors]
        simulator = grown(current.simulator, group)
        neutral = grown_theta(current.simulator, current.theta, group)
        moved = [replace(tried[i], candidate=members.index(tried[i].candidate)) for i in mine]
        theta = torch.stack([grown_theta(current.simulator, current.theta, group, trial) for trial in moved])
        raw, valid = columns(simulator, windows, neutral, theta, current.lin.starts)
        found.update(zip(mine, raw * valid[:, None, None, None], strict=True))
    found.update({i: -found[other] for i, other in mirrors.items()})
    return torch.stack([found[i] for i in range(len(tried))])


def _in_time(
    current: Fit, windows: Windows, effects: Sequence[Effect], tried: Sequence[Trial]
) -> dict[int, Float[Tensor, "W n S"]]:
    """How the replay moves with the trials that move a fitted parameter in time: its own column times their shift."""
    names = current.simulator.parameters.names
    begin, end = (instant.to(current.theta) for instant in instants(windows))
    found = {}
    for i, trial in enumerate(tried):
        effect = effects[trial.candidate]
        if effect.target_kind != "parameter" or effect.target not in names:
            continue
        moved, still = (
            effect.shift({name: torch.full_like(begin, value) for name, value in values.items()}, begin, end)
            for values in (trial.values, effect.neutral)
        )
        if moved is not None and still is not None:
            column = current.lin.by_theta[..., names.index(effect.target)]
            found[i] = column * (moved - still)[:, None, None]
    return found


def starting_values(effect: Effect, trial: Trial, size: float) -> dict[str, float]:
    """Where a refit begins: the linear estimate of the first parameter, inside its bounds, off neutral."""
    first = effect.magnitude
    bounds, neutral = effect.parameters[first], effect.neutral[first]
    width = bounds.high - bounds.low
    value = neutral + size * trial.reach
    value = min(max(value, bounds.low + 1e-3 * width), bounds.high - 1e-3 * width)
    return {**trial.values, first: value}


def _confounding(current: Fit, windows: Windows, raw: Float[Tensor, "W n S"]) -> tuple[str, ...]:
    """The free parameters whose sensitivities make up this one's, largest share first; the starts without any."""
    projected = project(windows, current.lin)
    c = projected.project(noise_rows(windows, raw[..., None])).flatten()
    F = projected.columns.flatten(0, 1)
    names = current.simulator.parameters.names
    if float(c.norm()) == 0:
        return (MOVES_NOTHING,)
    if not len(names):
        return ("the windows' starts",)
    shares = torch.linalg.lstsq(F / F.norm(dim=0).clamp_min(1e-300), c[:, None]).solution[:, 0].abs()
    order = shares.argsort(descending=True)
    return tuple(names[i] for i in order.tolist() if float(shares[i]) > 0.1 * float(shares.max()))
