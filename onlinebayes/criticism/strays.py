"""Starts that a step has led astray, brought back, and starts that no step of all windows together moves.

    s_w = argmin over candidates s of |r_w(theta, s)|^2

A step moves every window's start along by a linear rule. Where the motion is nearly unstable, or friction lets go, the
rule can throw one window's start a thousand standard deviations off, and the misfit of that window alone then decides
what is accepted. Given theta the windows are independent, so that each may take its best candidate: where the step put
it, where it was, as smoothed.

A step that overshoots in one window is refused in all of them, and a fit can end with a few starts far from their best.
At its end those that stand out take Gauss-Newton steps of their own, from where they are and as smoothed, and keep the
best place that they came through.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.criticism.projection import Projected, noise_rows, project, start_misfit, start_shift
from onlinebayes.criticism.replay import replay
from onlinebayes.criticism.sensitivities import Linearisation, linearise_starts
from onlinebayes.criticism.windows import Windows
from onlinebayes.simulators.base import Simulator

WORSE = 2.0  # times its misfit before the step
NOTICED = 0.01  # of the whole misfit
CONSPICUOUS = 2.0  # times the median misfit
OWN_STEPS = 3


def strays(before: Projected, after: Projected) -> Bool[Tensor, " W"]:
    """Windows whose misfit a step has at least doubled, to more than a hundredth of the whole."""
    was, now = (projected.residual.square().sum(1) for projected in (before, after))
    return (now > WORSE * was) & (now > NOTICED * now.sum())


def best_starts(
    simulator: Simulator,
    windows: Windows,
    row_weight: Float[Tensor, "W m"],
    theta: Float[Tensor, " P"],
    candidates: Float[Tensor, "K W J2"],
) -> Float[Tensor, "W J2"]:
    """For each window the candidate from which the replay at ``theta`` is nearest to what was measured."""
    error = window_errors(simulator, windows, row_weight, theta.expand(len(candidates), -1), candidates)
    return candidates[error.argmin(0), torch.arange(windows.count, device=error.device)]


def settled_starts(
    simulator: Simulator, windows: Windows, lin: Linearisation, projected: Projected
) -> Float[Tensor, "W J2"]:
    """The starts, those of conspicuous windows moved to the best place that steps of their own come through."""
    misfit = projected.residual.square().sum(1)
    worst = torch.nonzero(misfit > CONSPICUOUS * misfit.median())[:, 0]
    if not len(worst):
        return lin.starts
    twice = windows.select(worst.repeat(2))
    places = [torch.cat([lin.starts[worst], windows.start[worst]])]
    for _ in range(OWN_STEPS):
        here = linearise_starts(simulator, twice, lin.theta, places[-1])
        shift = start_shift(twice, here, project(twice, here, projected.weight), torch.zeros_like(lin.theta))
        places.append(places[-1] + shift)
    candidates = torch.stack(places).unflatten(1, (2, len(worst))).flatten(0, 1)
    row_weight = projected.row_weight[worst]
    found = best_starts(simulator, windows.select(worst), row_weight, lin.theta, candidates)
    return lin.starts.index_copy(0, worst, found)


def window_errors(
    simulator: Simulator,
    windows: Windows,
    row_weight: Float[Tensor, "W m"],
    theta: Float[Tensor, "M P"],
    starts: Float[Tensor, "M W J2"],
) -> Float[Tensor, "M W"]:
    """Weighed sum of squares of each window's rows, the start's prior included; inf where it diverged."""
    signals, valid = replay(simulator, windows, theta, starts)
    wrong = windows.bin(windows.value) - windows.bin(signals)
    rows = torch.stack([noise_rows(windows, one[..., None])[..., 0] for one in wrong])
    rows[..., -starts.shape[-1] :] = start_misfit(windows, starts)
    return torch.where(valid, (rows * row_weight).square().sum(2), float("inf"))
