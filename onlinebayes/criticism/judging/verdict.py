"""The verdict in one word, and what is left.

In this order: data_problem (a wiring fault explains the misfit, see ``wiring``), insufficient_data (nothing moves,
fewer than 7 windows' worth of motion, or an effect that only more independent blocks could decide on),
bounds_exclude_truth (see ``bounds``), tie (accepted effects remove half of the squared error above the floor, or reach
it, and the first one can be swapped for another that is not parted from it), missing_effect (they do, and it cannot),
adequate (nothing accepted, rms_over_floor within the tolerance), unexplained. Effects that leave more than that are
equals in explaining little: none of them is what is missing.

    two models are tied when their cross-validated RMS differ by less than 1 %, or when they are not parted (``score``)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from onlinebayes.criticism.judging.score import CrossValidated, parted
from onlinebayes.criticism.results import Verdict
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.blocks import BLOCK_CORRELATION_TIMES, FEWEST_BLOCKS
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.fitting.outlying_starts import best_starts
from onlinebayes.identification.fitting.projection import row_weights, start_shift
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.identification.results import Numerics

SAME = 0.01
AT_FLOOR = 1.2


def rms_over_floor(fitted: Fit, windows: Windows, numerics: Numerics) -> dict[str, float]:
    """Start-projected RMS at the rows over the floor, by signal: about 1 where nothing but noise is left.

    Replayed from each window's best start: the fit's own, or where its linearisation says that the best one is. A
    signal without an observed row has 0.

    Args:
        fitted, windows: the model and what it was fitted to.
        numerics: of its integration step; a larger error than the noise is the floor where it cannot be helped. A
            step that is fine enough for a gross misfit was chosen: there the floor is the noise alone.
    """
    shift = start_shift(windows, fitted.lin, fitted.projected, torch.zeros_like(fitted.theta))
    candidates = fitted.lin.starts + torch.stack([torch.zeros_like(shift), shift])
    weight = row_weights(windows, torch.ones_like(windows.noise))
    starts, _ = best_starts(fitted.simulator, windows, weight, fitted.theta, candidates)
    signals, _ = replay(fitted.simulator, windows, fitted.theta[None], starts[None])
    seen = windows.observed
    square = torch.where(seen, windows.value - signals[0], torch.zeros_like(windows.value)).square()
    rms = (square.sum((0, 1)) / seen.sum((0, 1)).clamp_min(1)).sqrt()
    error = 0.0 if numerics.sufficient else numerics.error_at_quarter_step
    floor = windows.noise * max(1.0, error)
    names = [fitted.simulator.signals[c] for c in windows.columns]
    return dict(zip(names, (rms / floor).tolist(), strict=True))


def left_over(grounds: Grounds) -> dict[str, float]:
    """RMS over the floor by signal of a fitted model."""
    return rms_over_floor(grounds.fitted, grounds.windows, grounds.numerics)


def tied(a: CrossValidated, b: CrossValidated, bin_step: float) -> bool:
    """Whether the data do not tell two models apart: they err alike, or are not parted."""
    return abs(a.rms_long - b.rms_long) < SAME * min(a.rms_long, b.rms_long) or not parted(a, b, bin_step)


@dataclass(frozen=True)
class Evidence:
    """What the verdict rests on.

    Args:
        enough: whether joints move, for at least 7 windows.
        undecided: whether an effect failed for nothing but too few independent blocks.
        numerics: of the base model.
        accepted: number of accepted effects.
        tie: whether the first of them can be swapped.
        bounds: whether a bound was found to exclude the truth.
        before, after: RMS over the floor of the base and the final model, by signal.
        miswired: whether a wiring fault explains the misfit.
        changed: whether a parameter was given a value in every run.
    """

    enough: bool
    undecided: bool
    numerics: Numerics
    accepted: int
    tie: bool
    bounds: bool
    before: Mapping[str, float]
    after: Mapping[str, float]
    miswired: bool = False
    changed: bool = False


def decide(found: Evidence, tolerance: float) -> Verdict:
    """The first verdict that applies.

    Args:
        found: what it rests on.
        tolerance: RMS over the floor up to which a model is adequate.
    """
    if found.miswired:
        return "data_problem"
    if not found.enough or (found.undecided and not found.accepted):
        return "insufficient_data"
    worst = max(found.after.values(), default=0.0)
    if not found.numerics.sufficient:
        # Where the integrator errs by less than the noise and no more than noise is left, nothing can be missing.
        quiet = not found.accepted and worst <= tolerance and found.numerics.error_at_quarter_step <= 1.0
        return "adequate" if quiet else "unexplained"
    if found.bounds:
        return "bounds_exclude_truth"
    if found.accepted:
        explains = halved(found.before, found.after) or worst <= AT_FLOOR
        return ("tie" if found.tie else "missing_effect") if explains else "unexplained"
    # A change of a parameter is no effect, and a model that lacks it does not agree with the measurements.
    return "adequate" if worst <= tolerance and not found.changed else "unexplained"


def halved(before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Whether at least half of the squared error above the floor is gone; by signal, in floors."""
    excess, left = (sum(max(0.0, value**2 - 1) for value in errors.values()) for errors in (before, after))
    return left <= 0.5 * excess


def what_to_record(blocks: int, moves: bool, windows: Windows, tau: float) -> str:
    """What would decide, in one sentence."""
    if not moves:
        return (
            "record runs in which the joints move: nothing here moves by more than 8 standard deviations of its sensor"
        )
    block = max(windows.horizon, BLOCK_CORRELATION_TIMES * tau)
    needed = FEWEST_BLOCKS * block
    return (
        f"record at least {needed:.3g} s of motion to fit, or at least {FEWEST_BLOCKS} separate runs: these data hold "
        f"{blocks} independent blocks of {block:.3g} s and {FEWEST_BLOCKS} are needed to tell a law from chance"
    )
