"""Starts that a step has led astray, brought back, and starts that no step of all windows together moves.

    s_w = argmin over candidates s of |r_w(theta, s)|^2

A step moves every window's start along by a linear rule. Where the motion is nearly unstable, or friction lets go, the
rule can throw one window's start a thousand standard deviations off, and the misfit of that window alone then decides
what is accepted. Given theta the windows are independent, so that each may take its best candidate: where the step put
it, where it was, as smoothed.

A step that overshoots in one window is refused in all of them, and a fit can end with a few starts far from their best.
At its end those that stand out take Gauss-Newton steps of their own, from where they are and as smoothed: each as large
a part of its step as serves it best, with coarse and fine differences in turn. (Where a carriage rests on top of a cog
a tenth of a millimetre a second decides where it goes: differences of some standard deviations see nothing of so narrow
a valley.) Those that neither moves take no more.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.criticism.data.windows import Windows
from onlinebayes.criticism.fitting.projection import (
    Projected,
    noise_rows,
    project,
    row_weights,
    start_misfit,
    start_shift,
)
from onlinebayes.criticism.fitting.sensitivities import Linearisation, linearise_starts
from onlinebayes.criticism.replaying.replay import replay
from onlinebayes.simulators.base import Simulator

WORSE = 2.0  # times its misfit before the step
NOTICED = 0.01  # of the whole misfit
CONSPICUOUS = 2.0  # times the median misfit
FINER = (1.0, 1000.0, 10.0, 100.0, 1000.0, 1000.0)  # times, the differences of one such step after the other
TRIED = 2  # of them, after which a start that gains nothing stays
PARTS = (0.0, 1.0, 0.3, 0.1, 0.03)  # none first: where all diverge a start stays


def strays(before: Projected, after: Projected) -> Bool[Tensor, " W"]:
    """Windows whose misfit a step has at least doubled, to more than a hundredth of the whole."""
    return strayed(*(projected.residual.square().sum(1) for projected in (before, after)))


def strayed(was: Float[Tensor, " W"], now: Float[Tensor, " W"]) -> Bool[Tensor, " W"]:
    """The same of the windows' misfits before and after."""
    return (now > WORSE * was) & (now > NOTICED * now.sum())


def best_starts(
    simulator: Simulator,
    windows: Windows,
    row_weight: Float[Tensor, "W m"],
    theta: Float[Tensor, " P"],
    candidates: Float[Tensor, "K W J2"],
) -> tuple[Float[Tensor, "W J2"], Float[Tensor, " W"]]:
    """For each window the candidate from which the replay at ``theta`` is nearest to what was measured, its misfit."""
    error = window_errors(simulator, windows, row_weight, theta.expand(len(candidates), -1), candidates)
    best = error.min(0)
    return candidates[best.indices, torch.arange(windows.count, device=error.device)], best.values


def settled_starts(
    simulator: Simulator, windows: Windows, lin: Linearisation, projected: Projected
) -> tuple[Float[Tensor, "W J2"], float, float]:
    """The starts, those of conspicuous windows moved to the better of the places where steps of their own end.

    Returns:
        The starts, and the misfit of all windows before and after.
    """
    misfit = misfits(windows, lin, projected.row_weight)
    before = float(misfit.sum())
    worst = torch.nonzero(misfit > CONSPICUOUS * misfit.median())[:, 0]
    if not len(worst) or not bool(windows.free.any()):
        return lin.starts, before, before
    whose = worst.repeat(2)
    starts = torch.cat([lin.starts[worst], windows.start[worst]])
    error = starts.new_full((len(starts),), float("inf"))
    left = torch.arange(len(starts), device=starts.device)
    for k, finer in enumerate(FINER):
        was, part = error[left], windows.select(whose[left])
        starts[left], error[left] = own_step(simulator, part, lin, projected, starts[left], finer)
        if k + 1 >= TRIED:
            left = left[error[left] < (1 - NOTICED) * was]
        if not len(left):
            break
    error, chain = error.view(2, -1).min(0)
    found = starts.view(2, len(worst), -1)[chain, torch.arange(len(worst), device=chain.device)]
    return lin.starts.index_copy(0, worst, found), before, float(misfit.index_copy(0, worst, error).sum())


def own_step(
    simulator: Simulator,
    windows: Windows,
    lin: Linearisation,
    projected: Projected,
    starts: Float[Tensor, "W J2"],
    finer: float,
) -> tuple[Float[Tensor, "W J2"], Float[Tensor, " W"]]:
    """Each start moved by the part of its own Gauss-Newton step that serves it best; its misfit there."""
    here = linearise_starts(simulator, windows, lin.theta, starts, finer)
    weight = row_weights(windows, projected.weight)
    shift = start_shift(windows, here, project(windows, here, projected.weight), torch.zeros_like(lin.theta))
    parts = lin.theta.new_tensor(PARTS)[:, None, None]
    return best_starts(simulator, windows, weight, lin.theta, starts + parts * shift)


def window_errors(
    simulator: Simulator,
    windows: Windows,
    row_weight: Float[Tensor, "W m"],
    theta: Float[Tensor, "M P"],
    starts: Float[Tensor, "M W J2"],
) -> Float[Tensor, "M W"]:
    """Weighed sum of squares of each window's rows, the start's prior included; inf where it diverged."""
    rows, valid = replayed_rows(simulator, windows, theta, starts)
    return torch.where(valid, (rows * row_weight).square().sum(2), float("inf"))


def misfits(windows: Windows, lin: Linearisation, row_weight: Float[Tensor, "W m"]) -> Float[Tensor, " W"]:
    """As :func:`window_errors`, at a linearisation's own point."""
    return (residual_rows(windows, lin.residual, lin.starts) * row_weight).square().sum(1)


def replayed_rows(
    simulator: Simulator, windows: Windows, theta: Float[Tensor, "M P"], starts: Float[Tensor, "M W J2"]
) -> tuple[Float[Tensor, "M W m"], Bool[Tensor, "M W"]]:
    """Residuals in noise units, the starts' priors' rows included, and which windows stayed finite."""
    signals, valid = replay(simulator, windows, theta, starts)
    wrong = windows.bin(windows.value) - windows.bin(signals)
    rows = [residual_rows(windows, one, start) for one, start in zip(wrong, starts, strict=True)]
    return torch.stack(rows), valid


def residual_rows(
    windows: Windows, residual: Float[Tensor, "W n S"], starts: Float[Tensor, "W J2"]
) -> Float[Tensor, "W m"]:
    """Residuals [SI] in noise units, with the starts' priors' rows."""
    rows = noise_rows(windows, residual[..., None])[..., 0]
    rows[:, -starts.shape[-1] :] = start_misfit(windows, starts)
    return rows
