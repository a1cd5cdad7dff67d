"""Extension of a density over some parameters to a space with new ones, of which nothing is known yet.

    p(theta, phi) = p(theta) u(phi),      u uniform on the unit cube of the new parameters

The new parameters follow the old ones, as ``Simulator.with_effect`` appends them.
"""

from __future__ import annotations

import torch

from onlinebayes.inference.base import Belief
from onlinebayes.inference.distributions import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.posterior import Posterior
from onlinebayes.parameters import ParameterSpace

FLAT = 5.0
"""Widths of the box in a Gaussian's scale: from the middle to an edge its density falls by half a percent."""


def extended(belief: Belief, space: ParameterSpace) -> BoxUniform | TruncatedMixture:
    """The belief over a space that has grown.

    Args:
        belief: over the first parameters of ``space``. A mixture keeps its components, anything else its box alone.
        space: with further parameters behind them.

    Raises:
        ValueError: the space does not begin with the belief's parameters.
    """
    old, new = belief.space.names, space.names
    if new[: len(old)] != old:
        raise ValueError(f"a belief over {', '.join(old)} in a space of {', '.join(new)}: it has to begin with these")
    more = len(new) - len(old)
    low, high = belief.box.low, belief.box.high
    box = Box(space, torch.cat([low, low.new_zeros(more)]), torch.cat([high, high.new_ones(more)]))
    inner = belief.distribution if isinstance(belief, Posterior) else belief
    if not isinstance(inner, TruncatedMixture):
        return BoxUniform(space, box)
    mean = torch.cat([inner.mean, inner.mean.new_full((*inner.mean.shape[:-1], more), 0.5)], dim=-1)
    lower = inner.scale_tril.new_zeros(*mean.shape, len(new))
    lower[..., : len(old), : len(old)] = inner.scale_tril
    lower[..., len(old) :, len(old) :] = FLAT * torch.eye(more).to(lower)
    return TruncatedMixture(inner.log_weights, mean, lower, box)
