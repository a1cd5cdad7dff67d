"""A normalising flow on a box, or the union of several: what a flow network says of theta.

    q(z) = 1/K sum_k |det dT(z; c_k) / dz|    inside [0, 1]^P, 0 outside
    log q(theta) = log q(z) + log |dz / dtheta|

T(.; c) maps the box onto itself, and u = T(z; c) is uniform on it: q needs no normaliser, and a draw is T^-1 of a
uniform one. K is 1 for one trajectory; a union holds one context for each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference.distributions.bijection import UnitBijection
from onlinebayes.inference.distributions.box import Box

ROWS = 65_536
"""Points that go through the layers at once: bounds the memory of a call with many."""


class FlowDensity:
    """A batch of flows over theta.

    Args:
        bijection: T, shared by the batch; not copied, so train it no further (a ``Posterior`` holds a copy).
        context: c_k of each (*batch, K, C).
        box: where the flow lives; it is zero elsewhere.
    """

    def __init__(self, bijection: UnitBijection, context: Float[Tensor, "*batch K C"], box: Box) -> None:
        self.bijection, self.context, self.box = bijection, context, box
        self.space = box.space

    @property
    def batch_shape(self) -> torch.Size:
        """Shape of the batch; empty for a single one."""
        return self.context.shape[:-2]

    def __getitem__(self, index: int) -> FlowDensity:
        """One of the batch, or a batch of one axis less."""
        return FlowDensity(self.bijection, self.context[index], self.box)

    def log_prob(self, theta: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """Log density on the original scale [1 / units]; ``theta`` (*sample, *batch, P) broadcasts against the batch.

        -inf outside the box. The answer lies where theta lies.
        """
        inside = self.box.contains(theta)
        theta = torch.where(inside.unsqueeze(-1), theta, self.space.from_unit(self.box.low.to(theta)))
        density = self.log_prob_frame(self.box.to_frame(theta)).to(theta.device) + self.box.log_abs_det(theta)
        return torch.where(inside, density, -torch.inf)

    def log_prob_frame(self, z: Float[Tensor, "*shape P"]) -> Float[Tensor, "*out"]:
        """Log density in the box's coordinates, for z inside [0, 1]^P."""
        z, (*batch, parts, _) = z.to(self.context), self.context.shape
        shape = z.shape[: max(z.ndim - 1 - len(batch), 0)]
        rows = z.expand(*shape, *batch, z.shape[-1]).reshape(-1, *batch, 1, z.shape[-1])
        rows = rows.expand(-1, *batch, parts, -1)
        values = torch.cat([self.bijection.log_abs_det(some, self.context) for some in rows.split(self._at_once)])
        return (torch.logsumexp(values, dim=-1) - math.log(parts)).reshape((*shape, *batch))

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Float[Tensor, "*out"]:
        """Theta (*shape, *batch, P), float64, inside the box always."""
        return self.box.from_frame(self.sample_frame(shape, generator))

    @torch.no_grad()
    def sample_frame(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*out"]:
        """z (*shape, *batch, P) in [0, 1]^P."""
        context, count = self.context, torch.Size(shape).numel()
        device = generator.device if generator is not None else context.device
        rows = context.reshape(-1, *context.shape[-2:])
        size = (count, len(rows))
        chosen = torch.randint(context.shape[-2], size, device=device, generator=generator).to(context.device)
        u = torch.rand((*size, len(self.space)), dtype=context.dtype, device=device, generator=generator).to(context)
        index = torch.arange(len(rows), device=context.device)
        pairs = zip(u.split(self._at_once), chosen.split(self._at_once), strict=True)
        z = torch.cat([self.bijection.inverse(some, rows[index, which]) for some, which in pairs])
        return z.reshape((*shape, *self.batch_shape, len(self.space)))

    @property
    def _at_once(self) -> int:
        """Points a density of the batch that go through the layers together."""
        return max(1, ROWS // max(1, self.context.shape[:-1].numel()))


def flow_union(flows: Sequence[FlowDensity]) -> FlowDensity:
    """1/n sum of n flows that one network gave."""
    if not flows:
        raise ValueError("no flow given; give at least one")
    first = flows[0]
    if any(flow.bijection is not first.bijection or flow.box is not first.box for flow in flows):
        raise ValueError("the flows come from different networks; unite those of one")
    # Every part has one vote: parts that are unions of their own would each count by their own number.
    if len({flow.context.shape[-2] for flow in flows}) > 1:
        raise ValueError("the flows are unions of different numbers; unite single ones")
    return FlowDensity(first.bijection, torch.cat([flow.context for flow in flows], dim=-2), first.box)
