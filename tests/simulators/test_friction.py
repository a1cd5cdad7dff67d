"""Coulomb's law holds at the end of a step, for one joint and for several that pull on each other."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from onlinebayes.simulators.friction import stick

WORLDS = 500


@pytest.mark.parametrize("joints", [(0,), (1,), (0, 1), (2, 0, 1)])
def test_coulombs_law(joints: tuple[int, ...]) -> None:
    free, mass = _systems(3)
    bound = torch.rand(len(joints), WORLDS, dtype=torch.float64)
    inverse = torch.linalg.inv(mass)
    velocity = stick(free, inverse[:, :, list(joints)].permute(1, 2, 0).contiguous(), bound, joints)
    impulse = (mass @ (velocity - free).T.unsqueeze(-1)).squeeze(-1).T
    for i, joint in enumerate(joints):
        v, p = velocity[joint], impulse[joint]
        stuck = v == 0
        assert 0.1 < stuck.double().mean() < 0.9  # both cases occur
        assert (p.abs() <= bound[i] * (1 + 1e-9)).all()
        torch.testing.assert_close(p[~stuck], -(bound[i] * v.sign())[~stuck], rtol=1e-8, atol=1e-10)
    others = [j for j in range(3) if j not in joints]
    torch.testing.assert_close(impulse[others], torch.zeros_like(impulse[others]), rtol=0, atol=1e-10)


def test_no_friction_is_nothing_bit_for_bit() -> None:
    free, mass = _systems(2)
    inverse = torch.linalg.inv(mass).permute(1, 2, 0).contiguous()
    assert torch.equal(stick(free, inverse, torch.zeros(2, WORLDS, dtype=torch.float64), (0, 1)), free)


def test_float32_ends_too() -> None:
    free, mass = _systems(2)
    inverse = torch.linalg.inv(mass).permute(1, 2, 0).contiguous()
    bound = torch.rand(2, WORLDS, dtype=torch.float64)
    single = stick(free.float(), inverse.float(), bound.float(), (0, 1))
    torch.testing.assert_close(single.double(), stick(free, inverse, bound, (0, 1)), rtol=1e-3, atol=1e-4)


def _systems(size: int) -> tuple[Tensor, Tensor]:
    """Velocities (J, N) and positive definite mass matrices (N, J, J)."""
    factor = torch.randn(WORLDS, size, size, dtype=torch.float64)
    return torch.randn(size, WORLDS, dtype=torch.float64), factor @ factor.mT + 0.3 * torch.eye(size)
