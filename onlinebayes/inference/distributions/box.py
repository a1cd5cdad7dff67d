"""A box inside the unit cube of a parameter space: the frame in which an estimator counts.

    z = (u - low) / (high - low),    u = space.to_unit(theta)

After a few rounds the posterior is a thousandth of the prior's box wide. A network that speaks of z keeps numbers of
order one, and single precision suffices; u and theta stay in double precision.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.parameters import ParameterSpace


@dataclass(frozen=True, eq=False)
class Box:
    """The box [low, high] in the unit cube of ``space``.

    Args:
        space: the parameters.
        low: smallest u of each parameter, in [0, 1), float64.
        high: largest u of each parameter, in (0, 1], float64.

    Raises:
        ValueError: a side without length or outside the cube.
    """

    space: ParameterSpace
    low: Float[Tensor, " P"]
    high: Float[Tensor, " P"]

    def __post_init__(self) -> None:
        if not bool(((self.low >= 0) & (self.low < self.high) & (self.high <= 1)).all()):
            raise ValueError(f"box [{self.low.tolist()}, {self.high.tolist()}]: needs 0 <= low < high <= 1")

    @classmethod
    def whole(cls, space: ParameterSpace) -> Box:
        """The unit cube itself: the prior's box."""
        return cls(space, torch.zeros(len(space), dtype=torch.float64), torch.ones(len(space), dtype=torch.float64))

    @property
    def log_volume(self) -> float:
        """Log of the share of the unit cube that the box fills."""
        return float(torch.log(self.high - self.low).sum())

    def cross(self, reach: float = 0.2) -> Float[Tensor, "R P"]:
        """Theta at the centre, and at pairs of points on either side of it, one pair a parameter: R = 1 + 2 P.

        Args:
            reach: how far out the pairs lie, 1 for the box's sides. Differences over the whole box miss the
                curvature: on Pendulum a reach of 0.1 gains one nat over a reach of 1.
        """
        size = len(self.space)
        steps = torch.stack([torch.eye(size), -torch.eye(size)], dim=1).reshape(2 * size, size).double()
        centre = torch.full((1, size), 0.5, dtype=torch.float64)
        return self.from_frame(torch.cat([centre, centre + reach / 2 * steps]))

    def to_frame(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch P"]:
        """z of theta, in float64; in [0, 1]^P inside the box."""
        return self.unit_to_frame(self.space.to_unit(theta.double()))

    def unit_to_frame(self, u: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch P"]:
        """z of a point u of the unit cube."""
        low, high = self.low.to(u), self.high.to(u)
        return (u - low) / (high - low)

    def from_frame(self, z: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch P"]:
        """Theta of z, in float64, never outside the prior's bounds by rounding."""
        z = z.double()
        low, high = self.low.to(z), self.high.to(z)
        if self.space.linear:
            return self.space.clamp(torch.lerp(self.space.from_unit(low), self.space.from_unit(high), z))
        return self.space.clamp(self.space.from_unit(torch.lerp(low, high, z).clamp(0, 1)))

    def log_abs_det(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch"]:
        """log |dz / dtheta|: adds to a log density of z to give the one of theta."""
        return self.space.log_abs_det(theta.double()) - self.log_volume

    def contains(self, theta: Float[Tensor, "*batch P"]) -> Bool[Tensor, "*batch"]:
        """Check whether theta lies in the box, edges (and rounding at them) included."""
        return self.holds(self.to_frame(theta))

    def holds(self, z: Float[Tensor, "*batch P"]) -> Bool[Tensor, "*batch"]:
        """Check whether a point given by its z lies in the box; see :meth:`contains`."""
        slack = 1e-12 / (self.high - self.low).to(z)
        return ((z >= -slack) & (z <= 1 + slack)).all(-1)
