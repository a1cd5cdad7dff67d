"""Distributions over the parameters of a space: uniform on its box, mixtures truncated to it."""

from onlinebayes.inference.distributions.box import Box
from onlinebayes.inference.distributions.mixture import TruncatedMixture
from onlinebayes.inference.distributions.uniform import BoxUniform

__all__ = ["Box", "BoxUniform", "TruncatedMixture"]
