"""Systems whose posterior is known exactly, as trajectories."""

from __future__ import annotations

from collections.abc import Callable

import torch
from tensordict import TensorDict

from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import ParameterSpace

STEPS = 4


def trajectories(
    theta: torch.Tensor, mean: Callable[[torch.Tensor], torch.Tensor], sd: float, generator: torch.Generator
) -> TensorDict:
    """Steps o' = o + mean(theta) + sd * noise from a random start; the action does nothing."""
    rows = len(theta)
    drift = mean(theta)
    size = drift.shape[-1]
    noise = torch.randn(rows, STEPS, size, dtype=torch.float64, generator=generator)
    change = drift.unsqueeze(1) + sd * noise
    start = torch.randn(rows, 1, size, dtype=torch.float64, generator=generator)
    path = torch.cat([start, start + change.cumsum(1)], 1)
    return TensorDict(
        {
            "observation": path[:, :-1],
            "action": torch.randn(rows, STEPS, 1, dtype=torch.float64, generator=generator),
            "next": {"observation": path[:, 1:]},
            "theta": theta,
        },
        batch_size=[rows],
    )


def exact_log_prob(
    data: TensorDict,
    points: torch.Tensor,
    volumes: torch.Tensor,
    space: ParameterSpace,
    mean: Callable[[torch.Tensor], torch.Tensor],
    sd: float,
) -> torch.Tensor:
    """Log posterior density (B, G) at the midpoints of a grid: likelihood times uniform prior, summed over the grid."""
    change = (data["next", "observation"] - data["observation"]).mean(1)
    gap = change.unsqueeze(1) - mean(points).unsqueeze(0)
    log_likelihood = -0.5 * STEPS * (gap / sd).square().sum(-1) + BoxUniform(space).log_prob(points)
    return log_likelihood - torch.logsumexp(log_likelihood + torch.log(volumes), -1, keepdim=True)
