"""A posterior made as wide as what it rests on: moments of inertia that nobody measured.

theta + A e,    e ~ N(0, V)        (A, V: :mod:`onlinebayes.identification.fitting.identifiability`)
"""

from __future__ import annotations

import torch

from onlinebayes.identification import rests_on_moments, weighed_by_noise
from onlinebayes.inference import Box, TruncatedMixture
from onlinebayes.inference.distributions.algebra import in_box
from onlinebayes.posterior.score import Score, unit_slope

LEAST = 0.01
"""Of a parameter's variance: with less the posterior stays as it is."""


def with_unmeasured_moments(belief: TruncatedMixture, score: Score) -> TruncatedMixture:
    """The belief with the moments' part in its covariance; itself where they say next to nothing.

    Args:
        belief: of the score, with the model's own moments.
        score: of the fit.
    """
    fit, space = weighed_by_noise(score.fitted, score.windows), score.fitted.simulator.parameters
    slope = unit_slope(space, score.fitted.theta).double()
    moved = rests_on_moments(fit, score.correlation_s, score.windows.bin_step).double() / torch.outer(slope, slope)
    whole = in_box(belief, Box.whole(space))
    covariance = whole.scale_tril @ whole.scale_tril.mT
    if not bool((moved.diagonal() > LEAST * covariance.diagonal(dim1=-2, dim2=-1)).any()):
        return belief
    return TruncatedMixture(
        whole.log_weights, whole.mean, torch.linalg.cholesky(covariance + (moved + moved.T) / 2), whole.box
    )
