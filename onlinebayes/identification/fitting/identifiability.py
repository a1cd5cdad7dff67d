"""What the data determine: parameters with intervals, and the directions of theta that they leave flat.

    J = C~ diag(range) / s_eff,   J = U S V',   a direction v_k is flat where S_k < 3: its sd fills a third of the prior

C~ are the start-projected sensitivities, s_eff^2 = s^2 tau / Delta the residual's variance times its correlation. A
parameter is identifiable when less than a tenth of it lies in flat directions. Intervals are the leave-one-block-out
jackknife's, widened by what the time step moves theta (see ``numerics``), Student's t with B - 1 degrees of freedom,
cut at the bounds; a run's own value adds the spread between its windows (see :mod:`.fitting.per_run_values`).
"""

from __future__ import annotations

import math
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.fitting.blocks import Blocks, jackknife, leave_one_out, t_quantile
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.per_run_values import own_covariance
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.results import Estimate, FlatDirection
from onlinebayes.parameters import Parameter

FLAT = 3.0
PART = 0.1
AT_BOUND = 1e-3
"""Share of what was allowed within which the mean lies at the end of it."""


def covariance_of(fitted: Fit, blocks: Blocks) -> Float[Tensor, "P P"]:
    """Jackknife covariance of theta [SI]; zero with a single block."""
    if blocks.count < 2 or not len(fitted.theta):
        return torch.zeros(len(fitted.theta), len(fitted.theta)).to(fitted.theta)
    across = jackknife(leave_one_out(fitted, blocks))
    return across + own_covariance(fitted, blocks) if isinstance(fitted.simulator, ScopedSimulator) else across


def flat_directions(fitted: Fit, tau: float, bin_step: float) -> tuple[FlatDirection, ...]:
    """The directions of theta, in shares of the parameters' ranges, that the data do not determine."""
    space, projected = fitted.simulator.parameters, fitted.projected
    if not len(space):
        return ()
    C, r = projected.columns.flatten(0, 1), projected.residual.flatten()
    width = (space.high - space.low).to(C)
    count = (projected.row_weight > 0).sum()
    s = (r.square().sum() / count * max(tau / bin_step, 1.0)).sqrt().clamp_min(1e-300)
    _, S, Vh = torch.linalg.svd(C * width / s, full_matrices=False)
    found = []
    for k in range(len(S)):
        if float(S[k]) < FLAT:
            v = Vh[k]
            names = [space.names[i] for i in v.abs().argsort(descending=True).tolist() if abs(float(v[i])) > PART]
            found.append(FlatDirection(_words(names), dict(zip(space.names, v.tolist(), strict=True))))
    return tuple(found)


def estimates(
    fitted: Fit, covariance: Float[Tensor, "P P"], blocks: int, flat: tuple[FlatDirection, ...]
) -> dict[str, Estimate]:
    """Mean, sd and 90 % interval of every parameter."""
    space = fitted.simulator.parameters
    reach = t_quantile(0.95, blocks)
    found = {}
    for i, name in enumerate(space):
        mean, sd = float(fitted.theta[i]), float(covariance[i, i].sqrt())
        bound = space[name]
        share = sum(direction.direction[name] ** 2 for direction in flat)
        wide = (bound.high - bound.low) / math.sqrt(12)
        sd = max(sd, wide) if share > PART else sd
        found[name] = Estimate(
            mean,
            sd,
            max(bound.low, mean - reach * sd),
            min(bound.high, mean + reach * sd),
            bound.unit,
            share <= PART,
            _at_bound(mean, bound),
        )
    return found


def _at_bound(mean: float, bounds: Parameter) -> Literal["low", "high"] | None:
    near = AT_BOUND * (bounds.high - bounds.low)
    if mean - bounds.low < near:
        return "low"
    return "high" if bounds.high - mean < near else None


def _words(names: list[str]) -> str:
    if len(names) == 1:
        return f"{names[0]} moves nothing that was measured"
    return f"only a combination of {', '.join(names)} is known, not each alone"
