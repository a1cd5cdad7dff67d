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
    # A billionth of the largest entry keeps a flat direction at zero without moving the others.
    diagonal = N.diagonal()
    N = N + torch.diag(damping * diagonal + 1e-9 * diagonal.max().clamp_min(1e-300) + 1e-300)
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
