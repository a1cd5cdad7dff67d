"""May this effect be added? Six rules, all of which must hold, the sixth of time effects; each failed one in words.

1. p of the maximum test below alpha, or that of the sign test: a gain in all B blocks, times the candidates that were
   tried, C 2^-B (Bonferroni). Screening is linear, and where contacts stick a straight line sees little of an effect.
   What leaves noise, or a quarter, of a gross misfit needs no p (``stage.explains``).
2. The cross-validated RMS at H falls by at least 5 %.
3. score_gain >= 2 standard errors at H, or a gain in each of 7 blocks or more; cross-validated RMS at H_s falls, too.
4. The leave-one-block-out jackknife interval (95 %, Student's t with B - 1 degrees) excludes the neutral value.
5. Homogeneous: one law, not a patch.
6. A time effect must move the replay more than the integration error does: an integrator of first order shifts time by
   half a step, and a dead time whose 95 % upper bound stays below a step of it is the integrator's, not the system's.
   (The replay's own change at a quarter of the step tells the order, so that RK4 is not held to its step.)
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from onlinebayes.criticism.judging.homogeneity import first_columns, homogeneous
from onlinebayes.criticism.judging.score import CrossValidated, Gain, cross_validate, parted, score_gain
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import Blocks, t_quantile
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.identifiability import covariance_of
from onlinebayes.identification.results import Numerics
from onlinebayes.simulators.effects import Effect

TOO_LITTLE = "brings too little"
"""How the failure of rule 2 is called."""
LEAST_FALL = 0.05
ALIKE_STANDARD_ERRORS = 0.01  # standard errors between two effects that are the same motion


@dataclass(frozen=True)
class Judged:
    """One effect added to the current model, refitted and judged.

    Args:
        effect: the effect.
        p_value: of the maximum test.
        fitted: the grown model's fit.
        scores: its cross-validation.
        gain: over the current model.
        falls: of the cross-validated RMS at the long and the short horizon, as shares.
        homogeneous: rule 5.
        failed: the rules that it fails, each a few words, a colon and the numbers; empty when it may be added.
        undecided: whether it fails nothing but the number of independent blocks that its residual leaves.
    """

    effect: Effect
    p_value: float
    fitted: Fit
    scores: CrossValidated
    gain: Gain
    falls: tuple[float, float]
    homogeneous: bool
    failed: tuple[str, ...]
    undecided: bool = False

    @property
    def admissible(self) -> bool:
        """Whether it may be added."""
        return not self.failed


def judge(
    effect: Effect,
    p_value: float,
    fitted: Fit,
    current: CrossValidated,
    windows: Windows,
    blocks: Blocks,
    numerics: Numerics,
    alpha: float,
    tried: int = 1,
) -> Judged:
    """Apply the rules to a model that was fitted with ``effect`` added, one of ``tried`` candidates."""
    scores = cross_validate(fitted, windows, blocks)
    gain = score_gain(scores, current, windows.bin_step)
    falls = (1 - scores.rms_long / current.rms_long, 1 - scores.rms_short / current.rms_short)
    same = homogeneous(fitted, windows, blocks, effect, scores.tau)
    low, high = interval(fitted, blocks, effect)
    neutral = effect.neutral[effect.magnitude]
    failed = []
    if not min(p_value, gain.sign_p(tried)) < alpha:
        failed.append(f"may be chance: p = {p_value:.3g} is not below {alpha:g}")
    if falls[0] < LEAST_FALL:
        fall = f"falls by {100 * falls[0]:.1f} %, not by {100 * LEAST_FALL:g} %" if falls[0] > 0 else "does not fall"
        failed.append(f"{TOO_LITTLE}: the cross-validated error {fall}")
    if not gain.clear:
        lost = f"{gain.blocks - gain.better} of {gain.blocks} blocks lose"
        failed.append(f"weak evidence: gain {gain.gain:.3g} is below two standard errors ({gain.se:.3g} each; {lost})")
    if falls[1] <= 0:
        failed.append("no gain at once: the error over short windows does not fall")
    if low <= neutral <= high:
        within = f"lies in [{low:.3g}, {high:.3g}]" if high > low else f"is {low:.3g}"
        failed.append(f"may be nothing: its size {within}")
    if not same:
        failed.append("a patch, not a law: its size differs between parts of the data")
    if effect.parameters[effect.magnitude].unit == "s" and _within_integration(fitted, effect, high, numerics):
        step = fitted.simulator.timestep
        failed.append(f"too short to tell: the integration step of {step:g} s shifts time as much as it does")
    return Judged(effect, p_value, fitted, scores, gain, falls, same, tuple(failed))


def interval(fitted: Fit, blocks: Blocks, effect: Effect) -> tuple[float, float]:
    """95 % jackknife interval of the effect's first parameter [SI].

    With one value a run it is the interval of the run that is furthest from neutral for its width, at a level shared
    out among the runs (Bonferroni).
    """
    columns = first_columns(fitted, effect)
    sd = covariance_of(fitted, blocks).diagonal().sqrt()[columns]
    away = fitted.theta[columns] - effect.neutral[effect.magnitude]
    clearest = int((away.abs() / sd.clamp_min(1e-300)).argmax())
    reach = t_quantile(1 - 0.025 / len(columns), blocks.count) * float(sd[clearest])
    mode = float(fitted.theta[columns[clearest]])
    return mode - reach, mode + reach


def _within_integration(fitted: Fit, effect: Effect, high: float, numerics: Numerics) -> bool:
    """Whether the largest plausible size of a time effect moves the replay as little as the integrator's shift does."""
    long = fitted.projected
    moved = long.measured_rows(long.columns[..., first_columns(fitted, effect)].sum(-1)) / long.weight * max(high, 0.0)
    rms = math.sqrt(float(moved.square().sum()) / max(int(long.seen().sum()), 1))
    # From h to h / 4 a first-order integrator's shift changes by 3 / 8 of h: a step is 2.7 times that.
    return rms < 2.7 * numerics.error_at_quarter_step


def choose(admissible: list[Judged], bin_step: float) -> Judged:
    """The best by score; of those that are not parted from it, the one with the fewest parameters.

    A richer effect waits for the simpler one that it contains; of two that fit alike to the last digits, the term at a
    joint or an actuator goes before the one of a body or the world.
    """
    keys = {judged.effect.key for judged in admissible}
    admissible = [j for j in admissible if not keys & contained(j.effect)]
    best = max(admissible, key=lambda judged: judged.gain.gain)

    rivals = [judged for judged in admissible if judged is best or not parted(best.scores, judged.scores, bin_step)]
    first = min(rivals, key=lambda judged: (len(judged.fitted.theta), -judged.gain.gain))
    alike = [
        judged
        for judged in rivals
        if len(judged.fitted.theta) == len(first.fitted.theta)
        and first.gain.gain - judged.gain.gain <= ALIKE_STANDARD_ERRORS * first.gain.se
    ]
    return min(alike, key=lambda judged: judged.effect.target_kind not in ("joint", "actuator"))


def contained(effect: Effect) -> set[str]:
    """Keys of the simpler effects that this one becomes for some of its values."""
    return {f"{name}@{effect.element}" for name in effect.contains}
