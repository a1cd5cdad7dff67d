"""Least squares within bounds, from the normal equations.

    argmin d' N d - 2 g' d    within low <= d <= high

The free minimum by Cholesky where it lies inside, else bounded-variable least squares on the triangle (Stark and Parker
1995).
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import lsq_linear
from torch import Tensor

ALIKE = 1e-7
"""Of the columns' squares: parameters whose columns differ by less than the root of that part are not told apart."""


def bounded_least_squares(
    normal: Float[Tensor, "P P"],
    gradient: Float[Tensor, " P"],
    low: Float[Tensor, " P"],
    high: Float[Tensor, " P"],
    damping: float = 0.0,
) -> Float[Tensor, " P"]:
    """argmin d' N d - 2 g' d within low <= d <= high; directions without information stay where they are.

    Args:
        normal: N = C' C.
        gradient: g = C' r.
        low, high: bounds of d, low <= 0 <= high.
        damping: lambda, relative to N's diagonal.
    """
    if not len(gradient):
        return gradient
    scale = (high - low).clamp_min(1e-300)
    N = normal * scale[:, None] * scale
    # What two parameters do alike is known to the rounding of differences only: a fit that follows it wanders. A
    # billionth of the largest entry keeps what moves nothing at zero. Neither moves the other directions.
    diagonal = N.diagonal()
    N = N + torch.diag((damping + ALIKE) * diagonal + 1e-9 * diagonal.max().clamp_min(1e-300) + 1e-300)
    g = gradient * scale
    root = torch.linalg.cholesky(N)
    free = torch.cholesky_solve(g[:, None], root)[:, 0]
    lower, upper = low / scale, high / scale
    if bool(((free >= lower) & (free <= upper)).all()):
        return free * scale
    target = torch.linalg.solve_triangular(root, g[:, None], upper=False)[:, 0]
    edge = 1e-12
    found = lsq_linear(
        root.T.cpu().numpy(),
        target.cpu().numpy(),
        (lower.cpu().numpy() - edge, upper.cpu().numpy() + edge),
        method="bvls",
    )
    return torch.as_tensor(np.asarray(found.x)).to(scale).clamp(lower, upper) * scale
