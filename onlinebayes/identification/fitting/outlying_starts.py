"""Initial states of single windows, re-estimated where a joint Gauss-Newton step left them far from their optimum.

    s_w = argmin over candidates s of |r_w(theta, s)|^2

A step moves every window's start along by a linear rule. Where the motion is nearly unstable, or friction lets go, the
rule can throw one window's start a thousand standard deviations off, and the misfit of that window alone then decides
what is accepted. Given theta the windows are independent, so that each may take its best candidate: where the step put
it, where it was, as smoothed.

A step that overshoots in one window is refused in all of them, and a fit can end with a few starts far from their best.
At its end those that stand out take Gauss-Newton steps of their own, from where they are and as smoothed: each as large
a part of its step as serves it best, with ever finer differences. (Where a carriage rests on top of a cog a tenth of a
millimetre a second decides where it goes: differences of some standard deviations see nothing of so narrow a valley.)
A step that promises next to nothing is not replayed; a start to which the finest differences promise nothing either is
settled, and so is the smoothed one that has come to where the other was.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import Projected, noise_rows, project, start_misfit, start_shift
from onlinebayes.identification.fitting.sensitivities import Linearisation, linearise_starts
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.simulators.identifiable import Identifiable

WORSE = 2.0  # times its misfit before the step
NOTICED = 0.01  # of the whole misfit
CONSPICUOUS = 2.0  # times the median misfit
OWN_STEPS = 6
FINER, FINEST = 10.0, 3  # differences, from one such step to the next, and how often
ARRIVED = 0.01  # sd of a smoothed start
LEAST_PROMISE = 0.1  # of what would be noticed, were it promised to every conspicuous window
START_STEP_PARTS = (0.0, 1.0, 0.3, 0.1, 0.03)  # none first: where all diverge a start stays


def worsened_windows(before: Projected, after: Projected) -> Bool[Tensor, " W"]:
    """Windows whose misfit a step has at least doubled, to more than a hundredth of the whole."""
    return worsened(*(projected.residual.square().sum(1) for projected in (before, after)))


def worsened(was: Float[Tensor, " W"], now: Float[Tensor, " W"]) -> Bool[Tensor, " W"]:
    """The same of the windows' misfits before and after."""
    return (now > WORSE * was) & (now > NOTICED * now.sum())


def best_starts(
    simulator: Identifiable,
    windows: Windows,
    row_weight: Float[Tensor, "W m"],
    theta: Float[Tensor, " P"],
    candidates: Float[Tensor, "K W J2"],
) -> tuple[Float[Tensor, "W J2"], Float[Tensor, " W"]]:
    """For each window the candidate from which the replay at ``theta`` is nearest to what was measured, its misfit."""
    error = replayed_misfits(simulator, windows, row_weight, theta.expand(len(candidates), -1), candidates)
    best = error.min(0)
    return candidates[best.indices, torch.arange(windows.count, device=error.device)], best.values


def refit_outlying_starts(
    simulator: Identifiable, windows: Windows, lin: Linearisation, projected: Projected
) -> tuple[Float[Tensor, "W J2"], float, float]:
    """The starts, those of conspicuous windows moved to the better of the places where steps of their own end.

    Returns:
        The starts, and the misfit of all windows before and after.
    """
    row_weight, theta = projected.row_weight, lin.theta
    misfit = misfits(windows, lin, row_weight)
    before = float(misfit.sum())
    worst = torch.nonzero(misfit > CONSPICUOUS * misfit.median())[:, 0]
    if not len(worst) or not bool(windows.free.any()):
        return lin.starts, before, before
    part, least = windows.select(worst), LEAST_PROMISE * NOTICED * before / len(worst)
    settling = _Settling(simulator, part, row_weight[worst], projected.weight, theta, least)
    starts = torch.cat([lin.starts[worst], part.start])
    error, level = misfit.new_full((len(starts),), math.inf), worst.new_zeros(len(starts))
    going = torch.arange(len(starts), device=starts.device)
    for _ in range(OWN_STEPS):
        best, misses, hopeful = settling.step(going % len(worst), starts[going], FINER ** level[going])
        stays = (best == starts[going]).all(1)
        starts, error = starts.index_copy(0, going, best), error.index_copy(0, going, misses)
        # At the finest level the same step would follow from the same place.
        done = (level[going] == FINEST) & (stays | ~hopeful)
        level[going] = torch.where(hopeful, (level[going] + 1).clamp_max(FINEST), FINEST)
        going = going[~done]
        going = going[~settling.arrived(starts)[going]]
        if not len(going):
            break
    error, chain = error.view(2, -1).min(0)
    found = starts.view(2, len(worst), -1)[chain, torch.arange(len(worst), device=chain.device)]
    return lin.starts.index_copy(0, worst, found), before, float(misfit.index_copy(0, worst, error).sum())


@dataclass(frozen=True)
class _Settling:
    """Windows whose starts settle one by one at a given theta; steps that promise less than ``least`` are not tried."""

    simulator: Identifiable
    windows: Windows
    row_weight: Float[Tensor, "W m"]
    weight: Float[Tensor, " S"]
    theta: Float[Tensor, " P"]
    least: float

    def step(
        self, which: Int[Tensor, " N"], starts: Float[Tensor, "N J2"], finer: Float[Tensor, " N"]
    ) -> tuple[Float[Tensor, "N J2"], Float[Tensor, " N"], Bool[Tensor, " N"]]:
        """Starts of the windows ``which`` one step on, their misfits there, and which were promised something."""
        windows, row_weight = self.windows.select(which), self.row_weight[which]
        here = linearise_starts(self.simulator, windows, self.theta, starts, finer)
        freed, misfit = project(windows, here, self.weight), misfits(windows, here, row_weight)
        hopeful = ~(misfit - freed.residual.square().sum(1) <= self.least)  # what diverged is tried, too
        some = torch.nonzero(hopeful)[:, 0]
        if len(some):
            shift = start_shift(windows, here, freed, torch.zeros_like(self.theta))[some]
            tried = starts[some] + starts.new_tensor(START_STEP_PARTS)[:, None, None] * shift
            best, error = best_starts(self.simulator, windows.select(some), row_weight[some], self.theta, tried)
            starts, misfit = starts.index_copy(0, some, best), misfit.index_copy(0, some, error)
        return starts, misfit, hopeful

    def arrived(self, starts: Float[Tensor, "W2 J2"]) -> Bool[Tensor, " W2"]:
        """Which of the second half are where their windows' first ones are."""
        first, second = starts.view(2, *self.windows.start.shape)
        same = ((first - second).abs() <= ARRIVED * self.windows.start_sd).all(1)
        return torch.cat([torch.zeros_like(same), same])


def replayed_misfits(
    simulator: Identifiable,
    windows: Windows,
    row_weight: Float[Tensor, "W m"],
    theta: Float[Tensor, "M P"],
    starts: Float[Tensor, "M W J2"],
) -> Float[Tensor, "M W"]:
    """Weighed sum of squares of each window's rows, the start's prior included; inf where it diverged."""
    rows, valid = replayed_rows(simulator, windows, theta, starts)
    return torch.where(valid, (rows * row_weight).square().sum(2), float("inf"))


def misfits(windows: Windows, lin: Linearisation, row_weight: Float[Tensor, "W m"]) -> Float[Tensor, " W"]:
    """As :func:`replayed_misfits`, at a linearisation's own point."""
    return (residual_rows(windows, lin.residual, lin.starts) * row_weight).square().sum(1)


def replayed_rows(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, "M P"], starts: Float[Tensor, "M W J2"]
) -> tuple[Float[Tensor, "M W m"], Bool[Tensor, "M W"]]:
    """Residuals in noise units, the starts' priors' rows included, and which windows stayed finite."""
    binned, valid = replay_binned(simulator, windows, theta, starts)
    wrong = windows.bin(windows.value) - binned
    rows = [residual_rows(windows, one, start) for one, start in zip(wrong, starts, strict=True)]
    return torch.stack(rows), valid


def residual_rows(
    windows: Windows, residual: Float[Tensor, "W n S"], starts: Float[Tensor, "W J2"]
) -> Float[Tensor, "W m"]:
    """Residuals [SI] in noise units, with the starts' priors' rows."""
    rows = noise_rows(windows, residual[..., None])[..., 0]
    rows[:, -starts.shape[-1] :] = start_misfit(windows, starts)
    return rows
