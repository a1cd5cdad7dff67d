"""Trajectory -> vector: self-attention among its steps, and one learnt query that reads them (Vaswani et al. 2017).

    x_t = W z_t + p_t                                p_t: sines and cosines of t
    x <- x + A(x, x),    x <- x + MLP(x)             each layer, on values normalised before
    e = A(query, x),     A(q, x) = softmax(q K x / sqrt d) V x    over the recorded steps, in several heads

Every step sees every other at once, so that a long trajectory is as easy to learn from as a short one; the time taken
grows with the square of its length. There is no stepwise form: a new step changes what the earlier ones see.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.nn import functional

from onlinebayes.embeddings.base import Embedding, check_padding, cleared
from onlinebayes.embeddings.features import TransitionFeatures

LONGEST = 10_000.0
"""Of the wavelengths in p_t, in steps over 2 pi: beyond any trajectory that attention is fit for."""


class AttentionEmbedding(Embedding):
    """Masked self-attention over the features z of a trajectory, pooled by a learnt query.

    Args:
        features: what is told about each transition.
        width: length E of the vector and of each x_t.
        heads: number of heads, a divisor of half the width.
        layers: number of layers of self-attention.

    Raises:
        ValueError: a width that the heads do not divide into even parts.
    """

    def __init__(self, features: TransitionFeatures, width: int = 64, *, heads: int = 4, layers: int = 1) -> None:
        super().__init__(features)
        if width % (2 * heads):
            raise ValueError(f"width = {width} in {heads} heads: needs a multiple of {2 * heads}")
        self.size = width
        self.inputs = nn.Linear(features.signals, width)
        self.layers = nn.ModuleList(_Layer(width, heads) for _ in range(layers))
        self.query = nn.Parameter(torch.randn(width))
        self.read = _Attention(width, heads)

    def scale(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> None:
        """Nothing: z is standardised already."""

    def encode(self, features: Float[Tensor, "B T F"], mask: Bool[Tensor, "B T"]) -> Float[Tensor, "B E"]:
        """Embed features made before; see :meth:`Embedding.encode`."""
        check_padding(mask)
        x = self.inputs(cleared(features[..., : self.features.signals], mask))
        x = x + _positions(x)
        # Of a trajectory without a step the first row is looked at, which keeps it finite, and then left out.
        some = mask.any(1, keepdim=True)
        seen = torch.cat([mask[:, :1] | ~some, mask[:, 1:]], dim=1)
        for layer in self.layers:
            x = layer(x, seen)
        return self.read(self.query.expand(len(x), 1, -1), x, seen)[:, 0] * some


class _Layer(nn.Module):
    """Self-attention and a network for each step, both added to what came in."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.attention = _Attention(width, heads)
        self.before = nn.LayerNorm(width)
        self.network = nn.Sequential(
            nn.LayerNorm(width), nn.Linear(width, 2 * width), nn.SiLU(), nn.Linear(2 * width, width)
        )

    def forward(self, x: Float[Tensor, "B T E"], seen: Bool[Tensor, "B T"]) -> Float[Tensor, "B T E"]:
        """The next x."""
        normalised = self.before(x)
        x = x + self.attention(normalised, normalised, seen)
        return x + self.network(x)


class _Attention(nn.Module):
    """A(q, x) in several heads, and a linear map of what they give."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        # A bias of the keys would add the same to every step's logit: softmax does not see it.
        self.queries, self.keys = (nn.Linear(width, width, bias=False) for _ in range(2))
        self.values, self.outputs = nn.Linear(width, width, bias=False), nn.Linear(width, width)

    def forward(
        self, query: Float[Tensor, "B Q E"], x: Float[Tensor, "B T E"], seen: Bool[Tensor, "B T"]
    ) -> Float[Tensor, "B Q E"]:
        """Return for each query what it reads from the steps that are ``seen``."""
        q, k, v = (
            values.unflatten(-1, (self.heads, -1)).transpose(1, 2)
            for values in (self.queries(query), self.keys(x), self.values(x))
        )
        read = functional.scaled_dot_product_attention(q, k, v, attn_mask=seen[:, None, None])
        return self.outputs(read.transpose(1, 2).flatten(-2))


def _positions(x: Float[Tensor, "B T E"]) -> Float[Tensor, "T E"]:
    """p_t, in double precision until the end."""
    time = torch.arange(x.shape[1], dtype=torch.float64, device=x.device)
    scale = torch.linspace(0, math.log(LONGEST), x.shape[2] // 2, dtype=torch.float64, device=x.device)
    angle = time.unsqueeze(-1) * torch.exp(-scale)
    return torch.cat([angle.sin(), angle.cos()], dim=-1).to(x)
