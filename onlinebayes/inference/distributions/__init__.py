"""Distributions over the parameters of a space: uniform on its box, mixtures truncated to it, flows on it."""

from onlinebayes.inference.distributions.box import Box
from onlinebayes.inference.distributions.flow import FlowDensity
from onlinebayes.inference.distributions.mixture import TruncatedMixture
from onlinebayes.inference.distributions.uniform import BoxUniform

__all__ = ["Box", "BoxUniform", "FlowDensity", "TruncatedMixture"]
