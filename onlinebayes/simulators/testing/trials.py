"""Common parts of the checks: random parameters and commands, trajectories by steps, comparison of states."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.simulators.abilities import Measured
from onlinebayes.simulators.base import Simulator


@dataclass(frozen=True)
class Trial:
    """Random parameters, commands and the states to start from.

    Args:
        theta: (N, P), uniform on the unit cube of the space.
        start: complete states (N,), reached from rest under other commands.
        command: (N, T, U).
        times: (T,), the ends of T steps.
    """

    theta: Float[Tensor, "N P"]
    start: TensorDict
    command: Float[Tensor, "N T U"]
    times: Float[Tensor, " T"]

    @property
    def inputs(self) -> TensorDict:
        """Inputs of a rollout, batch size (N, T)."""
        return TensorDict({"command": self.command}, batch_size=self.command.shape[:2])

    @classmethod
    def draw(cls, simulator: Measured, steps: int, scale: float, seed: int) -> Trial:
        """A trial for all worlds of ``simulator``, whose states it overwrites."""
        generator = torch.Generator().manual_seed(seed)
        n, width = simulator.worlds, len(simulator.commands)
        u = torch.rand(n, len(simulator.parameters), generator=generator, dtype=torch.float64)
        theta = simulator.parameters.from_unit(u).to(simulator.device, simulator.dtype)
        command = scale * torch.randn(n, 2 * steps, width, generator=generator, dtype=torch.float64).to(
            simulator.device, simulator.dtype
        )
        simulator.reset(theta)
        for k in range(steps):
            simulator.step(step_inputs(command[:, k]))
        times = simulator.dt * torch.arange(1, steps + 1, dtype=torch.float64, device=simulator.device)
        return cls(theta, simulator.state, command[:, steps:], times)


def step_inputs(command: Float[Tensor, "N U"]) -> TensorDict:
    """Inputs of one step."""
    return TensorDict({"command": command}, batch_size=[len(command)])


def walk(simulator: Simulator, command: Float[Tensor, "N T U"]) -> TensorDict:
    """The states after each of T steps from where the worlds stand, batch size (N, T)."""
    return TensorDict.stack([simulator.step(step_inputs(command[:, k])) for k in range(command.shape[1])], dim=1)


def require(holds: bool, what: str) -> None:
    """Raise AssertionError with ``what`` is wrong."""
    if not holds:
        raise AssertionError(what)


def require_same(a: TensorDictBase, b: TensorDictBase, atol: float, what: str) -> None:
    """Every part of two states or trajectories agrees, to the bit for ``atol`` 0; NaN equals NaN."""
    a, b = a.exclude("valid"), b.exclude("valid")
    require(
        set(a.keys(True, True)) == set(b.keys(True, True)), f"{what}: the keys differ: {set(a.keys())}, {set(b.keys())}"
    )
    for key in a.keys(True, True):
        x, y = (value.double() if value.dtype == torch.bool else value for value in (a.get(key), b.get(key)))
        require(x.shape == y.shape, f"{what}: {key} has shape {tuple(x.shape)} and {tuple(y.shape)}")
        off = torch.where((x == y) | (x.isnan() & y.isnan()), torch.zeros_like(x), (x - y).abs())
        require(bool((off <= atol).all()), f"{what}: {key} differs by {float(off.max()):g}, allowed {atol:g}")
