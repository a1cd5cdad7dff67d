"""Starts that a step has led astray, brought back.

    s_w = argmin over candidates s of |r_w(theta, s)|^2,    candidates: where the step put it, where it was, as smoothed

A step moves every window's start along by a linear rule. Where the motion is nearly unstable, or friction lets go, the
rule can throw one window's start a thousand standard deviations off, and the misfit of that window alone then decides
what is accepted. Given theta the windows are independent, so that each may take its best candidate.
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.criticism.projection import Projected, noise_rows, start_misfit
from onlinebayes.criticism.replay import replay
from onlinebayes.criticism.windows import Windows
from onlinebayes.simulators.base import Simulator

WORSE = 2.0  # times its misfit before the step
NOTICED = 0.01  # of the whole misfit


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
