"""The standard normal between two bounds, exact far out in the tails.

    log_interval(a, b)   log(Phi(b) - Phi(a))
    between(a, b, w)     Phi^-1(Phi(a) + w (Phi(b) - Phi(a))): w in [0, 1] -> a point of [a, b]

Both reflect intervals on the positive side (Phi(b) - Phi(a) = Phi(-a) - Phi(-b)), where Phi rounds to one, and work
with log Phi, which does not underflow. Where this stands in equations: Genz (1992), J. Comput. Graph. Stat. 1, 141.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

# Bounds further out are moved here: log Phi is still an ordinary number there, -5e7 and -5e13.
FAR = {torch.float32: 1e4, torch.float64: 1e7}
NEAR = -12.0


def log_interval(a: Float[Tensor, "*batch"], b: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Log probability of a < x < b under N(0, 1); finite wherever b > a, differentiable in both."""
    far = FAR[a.dtype]
    a, b = a.clamp(-far, far), b.clamp(-far, far)
    reflect = a > 0
    lower, upper = torch.where(reflect, -b, a), torch.where(reflect, -a, b)
    # erfc is ten times as fast as log_ndtr and as good where it does not underflow: only the far tail takes the other.
    near = upper > NEAR
    safe_lower, safe_upper = torch.where(near, lower, -1.0), torch.where(near, upper, 1.0)
    mass = 0.5 * (torch.special.erfc(-safe_upper / math.sqrt(2)) - torch.special.erfc(-safe_lower / math.sqrt(2)))
    result = torch.log(mass.clamp(min=torch.finfo(a.dtype).tiny))
    tail = ~near
    if bool(tail.any()):
        result = result.masked_scatter(tail, _log_interval_far(lower[tail], upper[tail]))
    return result


def _log_interval_far(lower: Tensor, upper: Tensor) -> Tensor:
    below, above = torch.special.log_ndtr(lower), torch.special.log_ndtr(upper)
    # log(e^above - e^below); the gap's floor keeps an interval without width (both bounds clamped) finite.
    gap = (above - below).clamp(min=torch.finfo(lower.dtype).tiny)
    return above + torch.log(-torch.expm1(-gap))


def between(
    a: Float[Tensor, "*batch"], b: Float[Tensor, "*batch"], w: Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """The point of [a, b] below which a share w of that interval's normal mass lies; differentiable in a and b."""
    far = FAR[a.dtype]
    near_a, near_b = a.clamp(-far, far), b.clamp(-far, far)
    reflect = near_a + near_b > 0
    lower, upper = torch.where(reflect, -near_b, near_a), torch.where(reflect, -near_a, near_b)
    share = torch.where(reflect, 1 - w, w)
    log_p = torch.logaddexp(
        torch.special.log_ndtr(lower) + torch.log1p(-share), torch.special.log_ndtr(upper) + torch.log(share)
    )
    x = inverse_log_ndtr(log_p)
    x = torch.where(reflect, -x, x)
    return torch.minimum(torch.maximum(x, near_a), near_b)


def inverse_log_ndtr(log_p: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """x with log Phi(x) = log_p, by Newton's method; the last step carries the gradient dx = dlog_p Phi / phi."""
    with torch.no_grad():
        tail = -torch.sqrt((-2 * log_p - math.log(2 * math.pi)).clamp(min=1.0))
        middle = torch.special.ndtri(log_p.clamp(min=-10.0).exp().clamp(max=1 - torch.finfo(log_p.dtype).eps))
        x = torch.where(log_p < -10.0, tail, middle)
        for _ in range(3):
            x = x - (torch.special.log_ndtr(x) - log_p) * _inverse_hazard(x)
    # log Phi is concave: from the left, where `tail` starts, Newton's steps never overshoot.
    return x - (torch.special.log_ndtr(x) - log_p) * _inverse_hazard(x)


def _inverse_hazard(x: Tensor) -> Tensor:
    """Phi(x) / phi(x)."""
    # Beyond 5 the ratio explodes while log Phi no longer resolves x: hold it.
    return math.sqrt(math.pi / 2) * torch.special.erfcx(-x.clamp(max=5.0) / math.sqrt(2))
