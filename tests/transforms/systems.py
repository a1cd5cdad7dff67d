"""Small environments and distributions that the tests of transforms share."""

from __future__ import annotations

import torch
from torch import Tensor

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.simulators import SimulatorEnv


class Uniform:
    """U[low, high]^2; keeps how many rows it was asked for."""

    def __init__(self, low: float = 0.1, high: float = 1.0) -> None:
        self.low, self.high = low, high
        self.asked: list[int] = []

    def sample(self, shape: tuple[int, ...]) -> Tensor:
        self.asked.append(shape[0])
        return self.low + (self.high - self.low) * torch.rand(*shape, 2, dtype=torch.float64)


def make_env(worlds: int = 3, horizon: int = 500) -> SimulatorEnv:
    return SimulatorEnv(CartPole(["length", "mass"], worlds=worlds), CartPoleTask(horizon))
