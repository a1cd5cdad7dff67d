"""For each window the best of some starts: a start that a linearisation leads astray is not taken."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import noise_rows, start_misfit
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.simulators.identifiable import Identifiable


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
