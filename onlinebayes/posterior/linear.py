"""The posterior of a model that is linear around its fit: what draws are proposed from, and what stands in for them.

    t(u) = t - G (u - u_fit),     t | Sigma ~ N(0, Sigma g),  nu / g ~ chi^2_nu        (Student's t as a scale mixture)
    u | g ~ N,   precision  G' Sigma^-1 G / g + 1 / w^2,     w = 3: next to flat over the unit cube

cut off at the cube. Five equal parts of g stand for all.
"""

from __future__ import annotations

import torch
from scipy.stats import chi2
from torch import Tensor

from onlinebayes.inference import Box, TruncatedMixture
from onlinebayes.posterior.score import Score

LEVELS = (0.1, 0.3, 0.5, 0.7, 0.9)
"""Middles of five equal parts of the distribution of g."""

FLAT = 3.0
"""Widths of the prior: the sd that stands for knowing nothing of a direction."""


def linear_posterior(score: Score) -> TruncatedMixture:
    """The mixture, in the coordinates of the whole prior."""
    space = score.fitted.simulator.parameters
    box, theta = Box.whole(space), score.fitted.theta.double()
    u = space.to_unit(space.clamp(theta))
    G, t = score.slope.double(), score.here.double()
    precise = torch.linalg.solve(score.spread.scale.double(), torch.cat([G, t[:, None]], 1))
    information, pull = G.T @ precise[:, :-1], G.T @ precise[:, -1]
    prior, means, roots = torch.eye(len(space)).to(G) / FLAT**2, list[Tensor](), list[Tensor]()
    for level in LEVELS:
        g = score.spread.freedom / float(chi2.ppf(level, score.spread.freedom))
        covariance = torch.linalg.inv(information / g + prior)
        means.append(u + covariance @ (pull / g + prior @ (0.5 - u)))
        roots.append(torch.linalg.cholesky((covariance + covariance.T) / 2))
    logits = torch.zeros(len(LEVELS), dtype=torch.float64, device=u.device)
    return TruncatedMixture(logits, torch.stack(means), torch.stack(roots), box)
