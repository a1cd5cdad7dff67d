"""Embedding -> mixture of Gaussians over the parameters: a mixture density network (Bishop 1994), box-truncated.

    (logits, mu, L) = network(e)
    q(theta | x) = sum_k w_k N(z(theta); mu_k, L_k L_k^T) 1[z in box] / Z

with a full covariance a component, as in Papamakarios and Murray (2016) and BayesSim (Ramos, Possas and Fox 2019).
The means are held within a quarter of the box's width around it and the scales above a ten-thousandth of it: a
component can reach over an edge, and cannot run away from the box, where it would be nothing but its own tail.

An embedding that is *located* ends with a place c and a scale C of its own (a filter's estimate and its covariance):

    mu = c + C m,    L = C S

so that the network says (m, S) in units of what is known already, and a mode a thousandth of the box wide is no harder
to say than one that fills it. The first component still speaks of the box: it stays where the place is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor, nn

from onlinebayes.inference.distributions import Box, TruncatedMixture
from onlinebayes.inference.distributions.algebra import doubled, product, union, widened
from onlinebayes.parameters import ParameterSpace


class Limits(NamedTuple):
    """Smallest and largest scale, and farthest mean from the centre."""

    sharpest: float
    broadest: float
    reach: float


IN_BOX = Limits(1e-4, 2.0, 0.75)
"""In widths of the box."""

LOCATED = Limits(0.02, 8.0, 8.0)
"""In units of C: a scale begins at one, and a mean comes to the edge of what the filter thinks possible."""


class MixtureEstimator(TensorDictModuleBase):
    """Embedding (B, E) -> the parameters of K components a row.

    ``in_keys`` is ``["embedding"]``; ``out_keys`` are ``["logits", "mean", "scale_tril"]`` with shapes (B, K),
    (B, K, P) and (B, K, P, P), in the coordinates of :attr:`box`. :meth:`distribution` builds the distribution.

    Args:
        space: the parameters theta speaks of.
        embedding: length E of the embedding's vector.
        components: number K of Gaussians.
        hidden: width of the two hidden layers.
        trunk: in their place, a module from the embedding to ``hidden`` numbers: ``FourierFeatures``, for example.
        box: where the simulations were drawn, the proposal's box; the whole prior's by default.
        located: the embedding ends with c and C, see ``SetEmbedding``.
        diagonal: components without correlations, as in the published code of BayesSim; only to be compared.

    Attributes:
        widening: factor on every scale, 1 during training; see :func:`~onlinebayes.inference.fit`. A located network
            has none: its scales come out right, and a factor read off a hundred rows would only add their chance
            (coverage error .026 without, .049 with it; CartPole, 5 % noise, seeds 402 to 404, n = 1, 3, 6).
    """

    widening: Tensor

    def __init__(
        self,
        space: ParameterSpace,
        embedding: int,
        *,
        components: int = 5,
        hidden: int = 128,
        trunk: nn.Module | None = None,
        box: Box | None = None,
        located: bool = False,
        diagonal: bool = False,
    ) -> None:
        super().__init__()
        self.in_keys = ["embedding"]
        self.out_keys = ["logits", "mean", "scale_tril"]
        self.space, self.components = space, components
        self.box = box if box is not None else Box.whole(space)
        size = len(space)
        limits = torch.tensor([IN_BOX] + [LOCATED if located else IN_BOX] * (components - 1))
        self.register_buffer("_limits", limits, persistent=False)
        self._located = size + size * (size + 1) // 2 if located else 0
        embedding -= self._located
        if not located:
            self.register_buffer("widening", torch.ones(()))
        below = torch.tril_indices(size, size, offset=-1)
        # Where in L the scales and the shears stand: one product puts them there, and back in the gradient.
        places = torch.cat([torch.arange(size) * (size + 1), below[0] * size + below[1]])
        self.register_buffer("_places", nn.functional.one_hot(places, size**2).float(), persistent=False)
        self._row = below[0]
        layers = (nn.Linear(embedding, hidden), nn.SiLU(), nn.Linear(hidden, hidden), nn.SiLU())
        self.trunk = nn.Sequential(*layers) if trunk is None else trunk
        self.logits = nn.Linear(hidden, components)
        self.mean = nn.Linear(hidden, components * size)
        self.straight = nn.Linear(embedding, components * size, bias=False)
        self.scale = nn.Linear(hidden, components * size)
        # One parameter has nothing to shear with.
        sheared = size > 1 and not diagonal
        self.shear = nn.Linear(hidden, components * below.shape[1]) if sheared else None

    def parameters_of(
        self, embedding: Float[Tensor, "B E"]
    ) -> tuple[Float[Tensor, "B K"], Float[Tensor, "B K P"], Float[Tensor, "B K P P"]]:
        """Logits, means and Cholesky factors of the components."""
        batch, size = embedding.shape[0], len(self.space)
        embedding, place = embedding.tensor_split([embedding.shape[1] - self._located], dim=1)
        sharpest, broadest, reach = self._limits.to(embedding)[..., None].unbind(1)
        h = self.trunk(embedding)
        # A straight path beside the trunk: what is already an estimate of a parameter need not be learnt again.
        mean = _held((self.mean(h) + self.straight(embedding)).view(batch, self.components, size), reach)
        diagonal = sharpest + broadest * torch.sigmoid(self.scale(h).view(batch, self.components, size) - 2)
        entries = diagonal
        if self.shear is not None:
            # A shear counts in units of its row's own scale, so that a ridge is as easy to say as a ball.
            shear = self.shear(h).view(batch, self.components, -1) * diagonal[..., self._row.to(h.device)]
            entries = torch.cat([diagonal, shear], dim=-1)
        scale_tril = entries @ self._places[: entries.shape[-1]].to(entries)
        scale_tril = scale_tril.view(batch, self.components, size, size)
        if not self._located:
            return self.logits(h), 0.5 + mean, self.widening * scale_tril
        centre, unit = self._placed(place)
        return self.logits(h), centre + (unit @ mean[..., None])[..., 0], unit @ scale_tril

    def _placed(self, place: Float[Tensor, "B C"]) -> tuple[Float[Tensor, "B K P"], Float[Tensor, "B K P P"]]:
        """c and C of each component, of the first one the box's centre and width."""
        B, K, P = len(place), self.components, len(self.space)
        box = torch.eye(P).to(place).expand(B, K, P, P)
        row, column = torch.tril_indices(P, P, device=place.device)
        unit = _filled(place.new_zeros(B, P, P), place[:, P:], row, column)
        first = (torch.arange(K, device=place.device) == 0)[:, None]
        return torch.where(first, 0.5, place[:, None, :P]), torch.where(first[..., None], box, unit[:, None])

    @torch.no_grad()
    def begin(self, scale: Float[Tensor, " P"]) -> None:
        """Let all components begin alike, before training, with these scales [widths of the box].

        The first one's weights are copied to the others (Papamakarios and Murray 2016, Algorithm 2). Their weights in
        the mixture stay different, from which training tells them apart.

        Raises:
            ValueError: a located network, whose components begin at the place that its embedding tells.
        """
        if self._located:
            raise ValueError("a located network begins where its embedding says; begin() is for one in its box")
        for head in (self.mean, self.straight, self.scale, self.shear):
            for values in head.parameters() if head is not None else ():
                rows = values.view(self.components, -1)
                rows[1:] = rows[:1].clone()
        limits = IN_BOX
        share = ((scale - limits.sharpest) / limits.broadest).clamp(limits.sharpest, 1 - limits.sharpest)
        self.scale.bias.copy_((torch.logit(share) + 2).repeat(self.components))

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write the parameters of the mixtures beside the embedding."""
        values = self.parameters_of(tensordict.get("embedding"))
        for key, value in zip(self.out_keys, values, strict=True):
            tensordict.set(key, value)
        return tensordict

    def distribution(self, embedding: Float[Tensor, "B E"]) -> TruncatedMixture:
        """The batch of mixtures that the embeddings stand for."""
        return TruncatedMixture(*self.parameters_of(embedding), self.box)

    def united(self, factors: Sequence[TruncatedMixture]) -> TruncatedMixture:
        """The union of n batches (*G,)."""
        return union([doubled(mixture) for mixture in factors])

    def multiplied(self, factors: Sequence[TruncatedMixture], widening: float = 1.0) -> TruncatedMixture:
        """The product of n batches (*G,), their scales times ``widening`` before."""
        return product([widened(doubled(mixture), widening) for mixture in factors])


def _held(x: Tensor, reach: Tensor) -> Tensor:
    """Within (-reach, reach): x itself well inside, smoothly bent towards the limits."""
    return x * (1 + (x / reach).square().square()).sqrt().rsqrt()


def _filled(matrix: Tensor, values: Tensor, row: Tensor, column: Tensor) -> Tensor:
    result = torch.zeros_like(matrix)
    result[..., row, column] = values
    return matrix + result
