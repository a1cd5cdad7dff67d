"""Unit quaternions q = (w, u) and rotation vectors r, batched over leading axes: MuJoCo's conventions, in torch.

| quantity                        | equation                                              | code                |
|---------------------------------|-------------------------------------------------------|---------------------|
| first q, then p in q's frame    | q p = (w w' - u.u', w u' + w' u + u x u')             | :func:`product`     |
| the way back                    | q^-1 = (w, -u)                                        | :func:`inverse`     |
| from body axes to the world's   | R(q) x = x + 2 w u x x + 2 u x (u x x)                | :func:`rotated`     |
| turned by r about its own axes  | exp r = (cos(a/2), sin(a/2) r / a),   a = abs(r)      | :func:`exponential` |
| the shortest turn               | log q = 2 atan2(abs(u), w) u / abs(u),   w >= 0       | :func:`logarithm`   |

q and -q are the same orientation, and have the same logarithm. It is at most pi long: of larger turns it tells the rest
to a whole turn. With q exp(r), r is in the body's axes, as ``mj_integratePos`` and ``mj_differentiatePos`` have it:
https://mujoco.readthedocs.io/en/stable/APIreference/APIfunctions.html (``mju_subQuat``, ``mju_quatIntegrate``).
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor


def product(q: Float[Tensor, "*#batch 4"], p: Float[Tensor, "*#batch 4"]) -> Float[Tensor, "*batch 4"]:
    """Hamilton's product q p."""
    w, u = q[..., :1], q[..., 1:]
    v, t = p[..., :1], p[..., 1:]
    u, t = torch.broadcast_tensors(u, t)
    vector = w * t + v * u + torch.linalg.cross(u, t)
    return torch.cat([w * v - (u * t).sum(-1, keepdim=True), vector], dim=-1)


def inverse(q: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """The opposite turn of a unit quaternion."""
    return q * q.new_tensor([1.0, -1.0, -1.0, -1.0])


def rotated(q: Float[Tensor, "*#batch 4"], x: Float[Tensor, "*#batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Transform components x in the turned axes into components in the axes from which q turns."""
    u, x = torch.broadcast_tensors(q[..., 1:], x)
    t = 2 * torch.linalg.cross(u, x)
    return x + q[..., :1] * t + torch.linalg.cross(u, t)


def exponential(r: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 4"]:
    """The quaternion of a rotation vector [rad]."""
    half = r.norm(dim=-1, keepdim=True) / 2
    return torch.cat([half.cos(), 0.5 * torch.sinc(half / math.pi) * r], dim=-1)


def logarithm(q: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3"]:
    """The shortest rotation vector of a quaternion [rad], at most pi long."""
    q = torch.where(q[..., :1] < 0, -q, q)
    w, u = q[..., :1], q[..., 1:]
    size = u.norm(dim=-1, keepdim=True)
    small = size < 1e-12
    # Below that the angle is 2 size / w to all digits, and u / size would be 0 / 0.
    factor = torch.where(small, 2 / w.clamp_min(0.5), 2 * torch.atan2(size, w) / torch.where(small, 1.0, size))
    return factor * u
