"""Identifiability from the data: parameters with intervals, and the directions of theta that the data leave flat.

    J = C~ diag(range) / s_eff,   J = U S V',   a direction v_k is flat where S_k < 3: its sd fills a third of the prior

C~ are the start-projected sensitivities, s_eff^2 = s^2 tau / Delta the residual's variance times its correlation. A
parameter is identifiable when less than a tenth of it lies in flat directions and no bound holds it. Intervals are the
leave-one-block-out jackknife's, Student's t with B - 1 degrees of freedom, cut at the bounds. Few blocks may look alike
by chance: no direction is known better than the residual's own variance allows (Cramer 1946, Rao 1945),

    L L' = s_eff^2 (C~' C~)^-1,    L^-1 V L^-T = Q diag(v) Q'    ->    V' = L Q diag(max(v, 1)) Q' L'

A run's own value adds the spread between its windows (see :mod:`.fitting.per_run_values`); a bound that holds a
parameter adds d d', d the step that theta would take without it.

Where moments of inertia were never measured (see :mod:`.fitting.moments`; columns N~, sd S_0 of a relative change e),
they are projected out of J, with rows 1 / S_0, and the covariance grows by

    A V A',    A = -(C~' C~)^-1 C~' N~,    V = (S_0^-2 + N~'(N~ + C~ A) / s_eff^2)^-1
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
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.results import Estimate, FlatDirection
from onlinebayes.parameters import Parameter

FLAT = 3.0
PART = 0.1
AT_BOUND = 1e-3
"""Share of what was allowed within which the mean lies at the end of it."""


def covariance_of(fitted: Fit, blocks: Blocks, tau: float, bin_step: float) -> Float[Tensor, "P P"]:
    """Covariance of theta [SI]: the jackknife's, and no less than the noise allows; zero with a single block.

    Args:
        fitted: to the data.
        blocks: parts of the data that are left out in turn.
        tau: correlation time of the residual [s].
        bin_step: of its rows [s].
    """
    if blocks.count < 2 or not len(fitted.theta):
        return torch.zeros(len(fitted.theta), len(fitted.theta)).to(fitted.theta)
    across = jackknife(leave_one_out(fitted, blocks)) + pressed(fitted)
    across = at_least(across, noise_covariance(fitted, tau, bin_step))
    return across + own_covariance(fitted, blocks, across) if isinstance(fitted.simulator, ScopedSimulator) else across


def noise_covariance(fitted: Fit, tau: float, bin_step: float) -> Float[Tensor, "P P"]:
    """s_eff^2 (C~' C~)^-1, within what was allowed where the data are flat [SI]; arguments as :func:`covariance_of`."""
    space, s = fitted.simulator.parameters, _deviation(fitted, tau, bin_step)
    width = (space.high - space.low).to(s)
    C = fitted.projected.columns.flatten(0, 1) * width / s
    allowed = 12.0 * torch.eye(len(width)).to(s)
    return width[:, None] * torch.linalg.inv(C.T @ C + allowed) * width


def at_least(covariance: Float[Tensor, "P P"], least: Float[Tensor, "P P"]) -> Float[Tensor, "P P"]:
    """The covariance, but in no direction less than another, which is positive definite."""
    L = torch.linalg.cholesky(least)
    inner = torch.linalg.solve_triangular(L, covariance, upper=False)
    inner = torch.linalg.solve_triangular(L, inner.mT, upper=False)
    v, Q = torch.linalg.eigh((inner + inner.mT) / 2)
    root = L @ (Q * v.clamp_min(1.0).sqrt())
    return root @ root.mT


def pressed(fitted: Fit) -> Float[Tensor, "P P"]:
    """d d', where d is how theta would move if no bound held it: what stands on a bound moves all else, too [SI].

    Nothing is less than none: a lower bound of 0 holds.
    """
    space, theta = fitted.simulator.parameters, fitted.theta
    ends = [_at_bound(float(value), space[name]) for name, value in zip(space, theta, strict=True)]
    held = [end is not None and (end == "high" or space[name].low != 0) for name, end in zip(space, ends, strict=True)]
    if not any(held):
        return torch.zeros(len(theta), len(theta)).to(theta)
    C, r = fitted.projected.columns.flatten(0, 1), fitted.projected.residual.flatten()
    width = (space.high - space.low).to(theta)
    natural = space.low.to(theta) == 0
    low = torch.where(natural, -theta, -width)
    d = bounded_least_squares(C.T @ C, C.T @ r, low, width)
    return torch.outer(d, d)


def rests_on_moments(fitted: Fit, tau: float, bin_step: float) -> Float[Tensor, "P P"]:
    """Covariance of theta that the unmeasured moments give it [SI]; arguments as :func:`flat_directions`."""
    P = len(fitted.theta)
    if fitted.moments is None or not P:
        return torch.zeros(P, P).to(fitted.theta)
    space, s = fitted.simulator.parameters, _deviation(fitted, tau, bin_step)
    width = (space.high - space.low).to(s)
    C, N = (one.flatten(0, 1) / s for one in (fitted.projected.columns * width, fitted.moments.columns))
    A = -torch.linalg.pinv(C.T @ C, hermitian=True) @ (C.T @ N)
    V = torch.linalg.inv(torch.diag(fitted.moments.sd.square().reciprocal()) + N.T @ (N + C @ A))
    A = width[:, None] * A
    return A @ V @ A.T


def _deviation(fitted: Fit, tau: float, bin_step: float) -> Float[Tensor, ""]:
    """s_eff."""
    r = fitted.projected.residual.flatten()
    count = (fitted.projected.row_weight > 0).sum()
    return (r.square().sum() / count * max(tau / bin_step, 1.0)).sqrt().clamp_min(1e-300)


def flat_directions(fitted: Fit, tau: float, bin_step: float) -> tuple[FlatDirection, ...]:
    """The directions of theta, in shares of the parameters' ranges, that the data do not determine."""
    space, projected = fitted.simulator.parameters, fitted.projected
    if not len(space):
        return ()
    width, s = (space.high - space.low).to(projected.columns), _deviation(fitted, tau, bin_step)
    C = projected.columns.flatten(0, 1) * width / s
    _, S, Vh = torch.linalg.svd(_without_moments(C, fitted, s), full_matrices=False)
    found = []
    for k in range(len(S)):
        if float(S[k]) < FLAT:
            v = Vh[k]
            names = [space.names[i] for i in v.abs().argsort(descending=True).tolist() if abs(float(v[i])) > PART]
            words = _words(names) if float((C @ v).norm()) < FLAT else _words_of_moments(names)
            found.append(FlatDirection(words, dict(zip(space.names, v.tolist(), strict=True))))
    return tuple(found)


def _without_moments(C: Float[Tensor, "N P"], fitted: Fit, s: Float[Tensor, ""]) -> Float[Tensor, "M P"]:
    """Project the unmeasured moments out of the columns, within what is known of these moments."""
    if fitted.moments is None:
        return C
    K = len(fitted.moments.sd)
    N = torch.cat([fitted.moments.columns.flatten(0, 1) / s, torch.diag(fitted.moments.sd.reciprocal())])
    C = torch.cat([C, C.new_zeros(K, C.shape[1])])
    Q, _ = torch.linalg.qr(N)
    return C - Q @ (Q.T @ C)


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
        end = _at_bound(mean, bound)
        share = sum(direction.direction[name] ** 2 for direction in flat)
        wide = (bound.high - bound.low) / math.sqrt(12)
        sd = max(sd, wide) if share > PART else sd
        found[name] = Estimate(
            mean,
            sd,
            max(bound.low, mean - reach * sd),
            min(bound.high, mean + reach * sd),
            bound.unit,
            share <= PART and (end is None or (end == "low" and bound.low == 0)),
            end,
        )
    return found


def _at_bound(mean: float, bounds: Parameter) -> Literal["low", "high"] | None:
    near = AT_BOUND * (bounds.high - bounds.low)
    if mean - bounds.low < near:
        return "low"
    return "high" if bounds.high - mean < near else None


def _words(names: list[str]) -> str:
    if len(names) == 1:
        return f"{names[0]} is not known: within its bounds it moves what was measured too little"
    return f"only a combination of {', '.join(names)} is known, not each alone"


def _words_of_moments(names: list[str]) -> str:
    if len(names) == 1:
        return f"{names[0]} is known only as far as the model's moments of inertia are right, which were not measured"
    return f"only ratios of {', '.join(names)} are known: their size rests on moments of inertia that were not measured"
