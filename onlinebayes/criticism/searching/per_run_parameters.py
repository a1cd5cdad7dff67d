"""Does a parameter differ between runs? Each shared one with a value a run, everything refitted, against the effects.

A mass that was changed, a floor, a supply voltage: no law is missing, the model has one value too few. Such a change is
held to what an effect is held to (see ``acceptance``): (i) p of :mod:`.judging.contrasts`, the maximum over all
parameters, at half the level, for effects have taken theirs; (ii) cross-validated RMS at H down by 5 %, at H_s too,
score gain of two standard errors, every left-out run judged with the value that its other half gives
(:mod:`.fitting.per_run_values`); (iii) one run's value is off the shared one, at a level shared out among the runs;
(iv) one law within the runs: the same deviations in both halves of each, at either sign of v, for abs(v) and q above
and below their medians.

Beside an admissible effect, which has fewer parameters, it must predict better by two paired standard errors and leave
no more than noise. Where nothing is admissible it must remove half of the squared error above the floor.
Constants of nature (``option.*``) and the parameters of effects are not tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.judging.acceptance import LEAST_FALL
from onlinebayes.criticism.judging.contrasts import contrast_p_values
from onlinebayes.criticism.judging.homogeneity import one_law
from onlinebayes.criticism.judging.score import (
    STANDARD_ERRORS,
    CrossValidated,
    Gain,
    cross_validate,
    score_gain,
)
from onlinebayes.criticism.searching.stage import Stage
from onlinebayes.identification.data.noise import correlation_time
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import FEWEST_BLOCKS, Blocks, independent_parts, t_quantile
from onlinebayes.identification.fitting.descent import bounded_step
from onlinebayes.identification.fitting.fit import Fit, fit, residual_correlation_time
from onlinebayes.identification.fitting.identifiability import covariance_of
from onlinebayes.identification.fitting.per_run_values import run_halves
from onlinebayes.identification.fitting.projection import project, replace_columns
from onlinebayes.identification.replaying.scoped import ScopedSimulator, unscoped
from onlinebayes.identification.results import Selection
from onlinebayes.identification.scope import Scope, address_of
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable

MOST_CHANGES_REFITTED = 3
"""So many parameters are refitted with a value a run at most."""

HALF_LEVEL = 0.5
"""Share of the level that is left for what is asked after the effects."""


@dataclass(frozen=True)
class Differing:
    """The current model with one value of a parameter in every run, refitted and judged.

    Args:
        address: the parameter.
        p_value: of the maximum test over all parameters.
        fitted, scores: the fit and its cross-validation.
        gain, falls: over the current model, as for an effect.
        blocks: of the cross-validation.
        failed: the rules that it fails, in words; empty when it may stand.
    """

    address: str
    p_value: float
    fitted: Fit
    scores: CrossValidated
    gain: Gain
    falls: tuple[float, float]
    blocks: Blocks
    failed: tuple[str, ...]


def find_differing(
    current: Fit, windows: Windows, stage: Stage, runs: Sequence[str], selection: Selection
) -> tuple[Differing, ...]:
    """The parameters whose values may differ between runs, each tried alone, the best first.

    Args:
        current, windows: the model as it stands, and what it was fitted to.
        stage: the round of effects with this model, for its blocks and scores.
        runs: the fit runs.
        selection: how changes are judged.
    """
    free = [name for name in current.simulator.parameters if may_change(name)]
    if len(runs) < 2 or not free:
        return ()
    # A change makes whole runs err alike: how long noise is correlated shows in what own values leave.
    correlation = min(_left_correlation(split_by_run(current, windows, runs, address), windows) for address in free)
    level, tried = HALF_LEVEL * selection.alpha, []
    for address, p in contrast_p_values(current, windows, free, correlation).items():
        if p < level:
            apart = split_by_run(current, windows, runs, address)
            gain, falls = _gains(cross_validate(apart, windows, stage.blocks), stage.scores, windows)
            if falls[0] > 0.5 * LEAST_FALL:
                tried.append((gain.gain, p, apart, address))
    tried.sort(key=lambda one: -one[0])
    judged = []
    for _, p, apart, address in tried[:MOST_CHANGES_REFITTED]:
        try:
            fitted = fit(apart.simulator, windows, apart.theta, current.projected.weight, current.lin.starts)
        except BadInput:  # some run's value makes it diverge
            continue
        judged.append(_judged(current, fitted, windows, stage, address, p, selection))
    return tuple(sorted(judged, key=lambda one: -one.gain.gain))


def with_own_values(simulator: Identifiable, runs: Sequence[str], address: str) -> ScopedSimulator:
    """The simulator with one value of a parameter in every run, or every group of runs of its scope."""
    scope = simulator.scope if isinstance(simulator, ScopedSimulator) else Scope()
    return ScopedSimulator(unscoped(simulator), replace(scope, per_run=(*scope.per_run, address)), runs)


def split_by_run(current: Fit, windows: Windows, runs: Sequence[str], address: str) -> Fit:
    """The same fit with the parameter's column cut into one a run: nothing is simulated, the values are the shared one.

    Its cross-validation says to first order what own values would give.
    """
    simulator = with_own_values(current.simulator, runs, address)
    names = current.simulator.parameters.names
    source = [names.index(name if name in names else address) for name in simulator.parameters]
    seen = simulator.touches(windows).T.to(current.theta)[:, None, None, :]
    lin = replace(current.lin, theta=current.theta[source], by_theta=current.lin.by_theta[..., source] * seen)
    return Fit(simulator, lin, replace_columns(current.projected, windows, lin.by_theta), current.converged)


def beats(change: Differing, rival: CrossValidated, bin_step: float) -> bool:
    """Whether it predicts left-out blocks better than another model by two paired standard errors."""
    over = score_gain(change.scores, rival, bin_step)
    return over.gain > STANDARD_ERRORS * over.se


def _left_correlation(apart: Fit, windows: Windows) -> float:
    """Correlation time of what a split fit leaves after one step of its own [s]."""
    step, _ = bounded_step(apart.simulator, apart.projected, apart.theta, 0.0)
    long = project(windows, apart.lin)
    return correlation_time(long.measured_rows(long.residual - long.columns @ step), long.seen(), windows.bin_step)


def may_change(name: str) -> bool:
    """Whether a parameter is one that may change: no constant of nature, no effect's, none that differs already."""
    return "@" not in name and not name.startswith("option.") and address_of(name) == name


def _gains(scores: CrossValidated, current: CrossValidated, windows: Windows) -> tuple[Gain, tuple[float, float]]:
    falls = (1 - scores.rms_long / current.rms_long, 1 - scores.rms_short / current.rms_short)
    return score_gain(scores, current, windows.bin_step), falls


def _judged(
    current: Fit, fitted: Fit, windows: Windows, stage: Stage, address: str, p: float, selection: Selection
) -> Differing:
    """Apply the rules."""
    scores = cross_validate(fitted, windows, stage.blocks)
    gain, falls = _gains(scores, stage.scores, windows)
    shared = float(current.theta[current.simulator.parameters.index(address)])
    columns = [i for i, name in enumerate(fitted.simulator.parameters) if address_of(name) == address]
    away = fitted.theta[columns] - shared
    failed = []
    if falls[0] < LEAST_FALL:
        failed.append(f"the cross-validated error falls by {100 * falls[0]:.1f} %, not by {100 * LEAST_FALL:g} %")
    if not gain.clear:
        failed.append(f"score gain {gain.gain:.3g} is below two standard errors ({gain.se:.3g} each)")
    if falls[1] <= 0:
        failed.append("the error over short windows does not fall")
    if not _clear(fitted, stage.blocks, columns, away):
        failed.append("all its values may be the same")
    if not _one_law(fitted, windows, columns, away, scores.tau):
        failed.append("its values differ within the runs, too")
    if (
        count := independent_parts(windows, residual_correlation_time(fitted, windows), selection.folds)
    ) < FEWEST_BLOCKS:
        failed.append(f"what it leaves is slow: {count} independent blocks, not {FEWEST_BLOCKS}")
    return Differing(address, p, fitted, scores, gain, falls, stage.blocks, tuple(failed))


def _clear(fitted: Fit, blocks: Blocks, columns: list[int], away: Float[Tensor, " R"]) -> bool:
    """Whether some run's value is off the shared one, at 95 % shared out among the runs (Bonferroni)."""
    sd = covariance_of(fitted, blocks).diagonal().sqrt()[columns].clamp_min(1e-300)
    return float((away.abs() / sd).max()) > t_quantile(1 - 0.025 / len(columns), blocks.count)


def _one_law(fitted: Fit, windows: Windows, columns: list[int], away: Float[Tensor, " R"], correlation: float) -> bool:
    """Whether each run's deviation holds in both halves of it, and in every half of its motion."""
    parts = 2 * windows.run + run_halves(windows, torch.zeros_like(windows.run))
    return one_law(fitted, windows, columns, away, parts, correlation)
