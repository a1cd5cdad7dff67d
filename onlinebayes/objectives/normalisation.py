"""Running normalisation of what networks read, column by column, over everything that was learnt from so far.

    y = clip((x - mean) / sqrt(variance + eps), -c, c)
    after n further rows of mean m and variance v:      d = m - mean,      total = count + n
        mean     <- mean + d n / total
        variance <- (count variance + n v + d^2 count n / total) / total

Chan, Golub and LeVeque, Updating Formulae and a Pairwise Algorithm for Computing Sample Variances (1979).

Only :meth:`RunningNormalization.observe` moves the statistics, and an objective calls it with what it learns from. A
policy that acts, or is evaluated, leaves them as they are. They are buffers: ``state_dict`` holds them, and networks
that share one module share its statistics.
"""

from __future__ import annotations

from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn


@final
class RunningNormalization(nn.Module):
    """Normalise inputs, joined along their last axis, by their running mean and variance.

    For one key of a tensordict or several: ``TensorDictModule(RunningNormalization(O + G), [key, goal_key], [out])``.

    Args:
        width: O, of the inputs together.
        clip: c, the largest magnitude of an output, in standard deviations.
        eps: added to the variance, so that a constant column gives 0.
        device: of the statistics.
        dtype: of the statistics and the outputs.
    """

    mean: Float[Tensor, " O"]
    variance: Float[Tensor, " O"]
    count: Float[Tensor, ""]

    def __init__(
        self,
        width: int,
        *,
        clip: float = 10.0,
        eps: float = 1e-6,
        device: torch.device | str | None = None,
        dtype: torch.dtype = torch.float32,
    ) -> None:
        super().__init__()
        self.clip, self.eps = clip, eps
        self.register_buffer("mean", torch.zeros(width, device=device, dtype=dtype))
        self.register_buffer("variance", torch.ones(width, device=device, dtype=dtype))
        # Not an integer: a target network's buffers are interpolated with its weights.
        self.register_buffer("count", torch.zeros((), device=device, dtype=torch.float64))

    def forward(self, *inputs: Float[Tensor, "*batch _"]) -> Float[Tensor, "*batch O"]:
        """The joined inputs, normalised; before the first :meth:`observe` only clipped."""
        scale = (self.variance + self.eps).rsqrt()
        return ((_joined(inputs) - self.mean) * scale).clamp(-self.clip, self.clip)

    @torch.no_grad()
    def observe(self, *inputs: Float[Tensor, "*batch _"]) -> None:
        """Let the statistics follow further rows of any batch axes; rows with a NaN or infinity are left out."""
        rows = _joined(inputs).detach().reshape(-1, self.mean.shape[-1]).to(self.mean)
        rows = rows[rows.isfinite().all(-1)]
        if not rows.numel():
            return
        new, total = rows.shape[0], self.count + rows.shape[0]
        share = (new / total).to(self.mean)
        variance, mean = torch.var_mean(rows, 0, correction=0)
        difference = mean - self.mean
        self.variance.lerp_(variance, share).add_(difference.square() * (share * (1 - share)))
        self.mean.add_(difference * share)
        self.count.copy_(total)


def _joined(inputs: tuple[Tensor, ...]) -> Tensor:
    return inputs[0] if len(inputs) == 1 else torch.cat(inputs, -1)
