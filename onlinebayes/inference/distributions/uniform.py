"""The uniform distribution on the unit cube of a parameter space: p(u) = 1, log-uniform on a log scale."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.inference.distributions.box import Box
from onlinebayes.parameters import ParameterSpace


class BoxUniform:
    """Uniform on the bounds of ``space`` (or on a smaller ``box`` of its unit cube), edges included.

    Args:
        space: the parameters; a log-scale parameter is uniform in its logarithm.
        box: part of the unit cube; all of it by default.
    """

    def __init__(self, space: ParameterSpace, box: Box | None = None) -> None:
        self.space = space
        self.box = box if box is not None else Box.whole(space)

    def sample(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*shape P"]:
        """Theta (*shape, P), float64."""
        device = generator.device if generator is not None else self.box.low.device
        z = torch.rand((*shape, len(self.space)), dtype=torch.float64, device=device, generator=generator)
        return self.box.from_frame(z)

    def contains(self, theta: Float[Tensor, "*batch P"]) -> Bool[Tensor, "*batch"]:
        """Check whether theta lies in the box, edges included."""
        return self.box.contains(theta)

    def log_prob(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch"]:
        """Log density on the original scale [1 / units]; -inf outside."""
        inside = self.box.contains(theta)
        density = self.box.log_abs_det(torch.where(inside.unsqueeze(-1), theta, self.space.low.to(theta)))
        return torch.where(inside, density, -torch.inf)
