"""One round of the search: every candidate screened against the current model, the best refitted and judged."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.acceptance import Judged, judge
from onlinebayes.criticism.blocks import Blocks, make_blocks, t_quantile
from onlinebayes.criticism.candidates import Trial, grown, grown_theta, trials
from onlinebayes.criticism.fit import Fit, fit
from onlinebayes.criticism.noise import tau
from onlinebayes.criticism.projection import noise_rows, project
from onlinebayes.criticism.results import Numerics, Selection
from onlinebayes.criticism.score import PIECES, CrossValidated, cross_validate
from onlinebayes.criticism.screening import Column, Scores, block_scores, p_values
from onlinebayes.criticism.sensitivities import columns
from onlinebayes.criticism.windows import Windows
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect

REFIT_BELOW = 0.1
FEWEST_REFITS, MOST_REFITS = 2, 5


@dataclass(frozen=True)
class Screened:
    """One candidate after screening.

    Args:
        effect: the effect.
        z, p_value: of the maximum test; None where it is confounded.
        start: values from which its refit begins, short name -> value [SI].
        confounded_with: free parameters that do the same already.
        exclusion_limit: upper end of the 95 % interval of the first parameter's distance from neutral [SI].
    """

    effect: Effect
    z: float | None
    p_value: float | None
    start: dict[str, float]
    confounded_with: tuple[str, ...]
    exclusion_limit: float | None


@dataclass(frozen=True)
class Stage:
    """The current model, its blocks and scores, all candidates screened (best first) and the leading ones judged."""

    current: Fit
    windows: Windows
    blocks: Blocks
    scores: CrossValidated
    screened: tuple[Screened, ...]
    judged: tuple[Judged, ...]


def blocks_for(fitted: Fit, windows: Windows, folds: int | None) -> Blocks:
    """The blocks that the correlation of this fit's residual allows."""
    long = project(windows, fitted.lin)
    correlation = tau(long.measured_rows(long.residual), long.seen(), windows.bin_step)
    return make_blocks(windows, correlation, folds)


def run_stage(
    current: Fit,
    windows: Windows,
    effects: Sequence[Effect],
    numerics: Numerics,
    selection: Selection,
    say: Callable[[str], None],
    thorough: bool = True,
) -> Stage:
    """Screen all effects against the current model, refit the leading ones and judge them.

    Args:
        current, windows, numerics: the model as it stands, and what it was fitted on.
        effects: the candidates.
        selection: how they are judged.
        say: takes one line of progress.
        thorough: refit two at least and all below p = .1, for ties and the report; else those that may be accepted.
    """
    blocks = blocks_for(current, windows, selection.folds)
    scores = cross_validate(current, windows, blocks)
    screened = screen(current, windows, blocks, effects)
    leading = [s for s in screened if s.p_value is not None]
    fewest, below = (FEWEST_REFITS, REFIT_BELOW) if thorough else (0, selection.alpha)
    refits = [s for k, s in enumerate(leading) if k < fewest or (s.p_value or 0.0) < below][:MOST_REFITS]
    judged = []
    for candidate in refits:
        say(f"refitting with {candidate.effect.key}")
        try:
            fitted = refit(current, windows, candidate.effect, candidate.start)
        except BadInput:  # it diverges from where screening would start it
            continue
        judged.append(
            judge(
                candidate.effect, candidate.p_value or 0.0, fitted, scores, windows, blocks, numerics, selection.alpha
            )
        )
    return Stage(current, windows, blocks, scores, screened, tuple(judged))


def refit(current: Fit, windows: Windows, effect: Effect, start: dict[str, float]) -> Fit:
    """The current model with ``effect`` added, fitted to convergence from ``start``."""
    simulator = current.simulator.with_effect(effect)
    theta = torch.cat([current.theta, current.theta.new_tensor([start[name] for name in effect.parameters])])
    return fit(simulator, windows, theta, current.projected.weight, current.lin.starts)


def screen(current: Fit, windows: Windows, blocks: Blocks, effects: Sequence[Effect]) -> tuple[Screened, ...]:
    """z and p of every effect; the confounded ones last."""
    if not effects:
        return ()
    tried = trials(effects)
    horizons, raw = _sensitivities(current, windows, blocks, effects, tried)
    tests = [Column(trial.candidate, trial.two_sided) for trial in tried]
    z, p, best = p_values(horizons, tests, len(effects))
    found = []
    for k, effect in enumerate(effects):
        if int(best[k]) < 0:
            mine = next(i for i, trial in enumerate(tried) if trial.candidate == k)
            found.append(Screened(effect, None, None, {}, _confounding(current, windows, raw[mine]), None))
            continue
        i = int(best[k])
        found.append(
            Screened(
                effect,
                float(z[k]),
                float(p[k]),
                _starting_values(effect, tried[i], float(horizons[0].size[i])),
                (),
                _exclusion(horizons[0], i, blocks.count, tried[i]),
            )
        )
    return tuple(sorted(found, key=lambda s: (s.p_value is None, s.p_value, -(s.z or 0.0))))


def _sensitivities(
    current: Fit, windows: Windows, blocks: Blocks, effects: Sequence[Effect], tried: Sequence[Trial]
) -> tuple[list[Scores], Float[Tensor, "C W n S"]]:
    raw = _raw(current, windows, effects, tried)
    horizons = []
    for pieces in (1, PIECES):
        projected = project(windows, current.lin, current.projected.weight, pieces)
        c = projected.project(noise_rows(windows, raw.movedim(0, -1), pieces))
        horizons.append(block_scores(projected, c, blocks.of.repeat_interleave(pieces), blocks.count))
    return horizons, raw


def _raw(current: Fit, windows: Windows, effects: Sequence[Effect], tried: Sequence[Trial]) -> Float[Tensor, "C W n S"]:
    """How the binned replay moves under each trial; 0 where a world diverged.

    Candidates are grown together in groups that cost the same: those that MuJoCo carries inside the engine, those that
    make it walk timestep by timestep, and those whose hidden states remember equally long.
    """
    groups: dict[tuple[bool, float], list[int]] = {}
    for k, effect in enumerate(effects):
        groups.setdefault((effect.staged, effect.memory), []).append(k)
    found: dict[int, Tensor] = {}
    for members in groups.values():
        group = [effects[k] for k in members]
        mine = [i for i, trial in enumerate(tried) if trial.candidate in members]
        simulator = grown(current.simulator, group)
        neutral = grown_theta(current.simulator, current.theta, group)
        moved = [replace(tried[i], candidate=members.index(tried[i].candidate)) for i in mine]
        theta = torch.stack([grown_theta(current.simulator, current.theta, group, trial) for trial in moved])
        raw, valid = columns(simulator, windows, neutral, theta, current.lin.starts)
        found.update(zip(mine, raw * valid[:, None, None, None], strict=True))
    return torch.stack([found[i] for i in range(len(tried))])


def _starting_values(effect: Effect, trial: Trial, size: float) -> dict[str, float]:
    """Where a refit begins: the linear estimate of the first parameter, inside its bounds, off neutral."""
    first = effect.parameters.names[0]
    bounds, neutral = effect.parameters[first], effect.neutral[first]
    width = bounds.high - bounds.low
    value = neutral + size * trial.reach
    value = min(max(value, bounds.low + 1e-3 * width), bounds.high - 1e-3 * width)
    return {**trial.values, first: value}


def _exclusion(scores: Scores, column: int, blocks: int, trial: Trial) -> float:
    """Largest distance from neutral that the blocks' spread leaves possible [SI of the first parameter]."""
    size, g, norm = float(scores.size[column]), scores.g[:, column], float(scores.norm[column])
    se = math.sqrt(blocks / (blocks - 1) * float((g - g.mean()).square().sum())) / norm if blocks > 1 else math.inf
    return abs(trial.reach) * (abs(size) + t_quantile(0.975, blocks) * se)


def _confounding(current: Fit, windows: Windows, raw: Float[Tensor, "W n S"]) -> tuple[str, ...]:
    """The free parameters whose sensitivities make up this one's, largest share first."""
    projected = project(windows, current.lin)
    c = projected.project(noise_rows(windows, raw[..., None])).flatten()
    F = projected.columns.flatten(0, 1)
    names = current.simulator.parameters.names
    if not len(names) or float(c.norm()) == 0:
        return ("nothing moves",) if float(c.norm()) == 0 else ()
    shares = torch.linalg.lstsq(F / F.norm(dim=0).clamp_min(1e-300), c[:, None]).solution[:, 0].abs()
    order = shares.argsort(descending=True)
    return tuple(names[i] for i in order.tolist() if float(shares[i]) > 0.1 * float(shares.max()))
