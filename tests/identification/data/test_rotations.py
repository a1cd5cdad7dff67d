"""Against MuJoCo's own functions."""

import math

import mujoco
import numpy as np
import torch

from onlinebayes.identification.data.rotations import exponential, inverse, logarithm, product


def some(count: int) -> torch.Tensor:
    q = torch.randn(count, 4, dtype=torch.float64)
    return q / q.norm(dim=1, keepdim=True)


def test_products_and_turns_are_mujocos() -> None:
    for q, p, r in zip(some(20), some(20), torch.randn(20, 3, dtype=torch.float64), strict=True):
        expected = np.zeros(4)
        mujoco.mju_mulQuat(expected, q.numpy(), p.numpy())
        assert torch.allclose(product(q, p), torch.from_numpy(expected), atol=1e-14)
        turned = q.numpy().copy()
        mujoco.mju_quatIntegrate(turned, r.numpy(), 1.0)
        assert torch.allclose(product(q, exponential(r)), torch.from_numpy(turned), atol=1e-14)
        away = np.zeros(3)
        mujoco.mju_subQuat(away, p.numpy(), q.numpy())
        assert torch.allclose(logarithm(product(inverse(q), p)), torch.from_numpy(away), atol=1e-13)


def test_the_logarithm_undoes_the_exponential_up_to_half_a_turn() -> None:
    axis = torch.nn.functional.normalize(torch.randn(7, 3, dtype=torch.float64), dim=1)
    angles = torch.tensor([0.0, 1e-300, 1e-13, 1e-6, 0.1, 2.0, math.pi - 1e-6], dtype=torch.float64)
    r = angles[:, None] * axis
    assert torch.allclose(logarithm(exponential(r)), r, rtol=1e-9, atol=1e-300)
    assert torch.equal(logarithm(-exponential(r)), logarithm(exponential(r)))
    more = (2 * math.pi - 0.5) * axis
    assert torch.allclose(logarithm(exponential(more)), -0.5 * axis, atol=1e-12)  # the shorter way round
