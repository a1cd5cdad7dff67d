"""Embedding -> normalising flow over the parameters, on their box: any shape of posterior, for more simulations.

    c = trunk(e),    q(theta | x) = |det dT(z(theta); c) / dz| |dz / dtheta|

T is a bijection of the box onto itself (``kind="nsf"``, splines; or ``"maf"``, see
:class:`~onlinebayes.inference.distributions.bijection.UnitBijection`), so that q is zero outside the box and
normalised over it without a correction, in the loss as in use.

The product of several flows has no closed form, and no bijection makes a flow wider by a factor: trajectories are
combined by the union of their flows, which is cautious and does not narrow with their number.
"""

from __future__ import annotations

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor, nn

from onlinebayes.inference.distributions import Box
from onlinebayes.inference.distributions.bijection import Kind, UnitBijection
from onlinebayes.inference.distributions.flow import FlowDensity, flow_union
from onlinebayes.parameters import ParameterSpace


class FlowEstimator(nn.Module):
    """A :class:`~onlinebayes.inference.base.ConditionalDensity` by zuko's flows.

    Args:
        space: the parameters theta speaks of.
        embedding: length E of the embedding's vector.
        kind: ``"nsf"`` or ``"maf"``; the second is quicker, and wrong next to the box's edges.
        layers: number of autoregressive layers.
        hidden: width of the trunk's two hidden layers, and of one in each autoregressive layer.
        bins: of a spline.
        trunk: in place of those layers, a module from the embedding to ``hidden`` numbers.
        box: where the simulations were drawn, the proposal's box; the whole prior's by default.

    Raises:
        BadInput: another kind, or zuko is not installed.
    """

    def __init__(
        self,
        space: ParameterSpace,
        embedding: int,
        *,
        kind: Kind = "nsf",
        layers: int = 3,
        hidden: int = 64,
        bins: int = 8,
        trunk: nn.Module | None = None,
        box: Box | None = None,
    ) -> None:
        super().__init__()
        self.space, self.box = space, box if box is not None else Box.whole(space)
        dense = (nn.Linear(embedding, hidden), nn.SiLU(), nn.Linear(hidden, hidden), nn.SiLU())
        self.trunk = nn.Sequential(*dense) if trunk is None else trunk
        self.bijection = UnitBijection(kind, len(space), hidden, layers=layers, hidden=hidden, bins=bins)

    def distribution(self, embedding: Float[Tensor, "B E"]) -> FlowDensity:
        """The batch of flows that the embeddings stand for."""
        return FlowDensity(self.bijection, self.trunk(embedding).unsqueeze(-2), self.box)

    def united(self, factors: Sequence[FlowDensity]) -> FlowDensity:
        """The union of n batches (*G,)."""
        return flow_union(factors)
