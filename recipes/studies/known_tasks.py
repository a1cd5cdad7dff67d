"""Inference tasks whose exact posterior can be drawn from, as the simulation-based inference benchmark has them.

| task             | x                                                 | exact posterior                              |
|------------------|---------------------------------------------------|----------------------------------------------|
| linear Gaussian  | N(theta, .1 I), 2 and 10 parameters               | the same Gaussian, cut off at the box        |
| edge             | the same, the truth .02 from a corner of the box  | the same                                     |
| Gaussian mixture | half N(theta, I), half N(theta, .01 I)            | the same mixture, cut off                    |
| two moons        | a crescent + (-abs(a + b), b - a) / sqrt 2        | two crescents, by turning the shift round    |
| SLCP             | four points of a 2-D Gaussian of five parameters  | chains of Metropolis from weighted draws     |

J.-M. Lueckmann, J. Boelts, D. Greenberg, P. Goncalves, J. Macke, Benchmarking Simulation-Based Inference (2021).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace

Simulator = Callable[[Float[Tensor, "N P"], torch.Generator], Float[Tensor, "N D"]]


@dataclass(frozen=True)
class KnownTask:
    """A simulator and its exact posterior.

    Args:
        space: parameters, uniform within their bounds.
        simulate: (theta, generator) -> x.
        draw: (x (D,), number, generator) -> draws of the exact posterior (number, P).
        truth: where measurements are made; anywhere under the prior without it.
    """

    space: ParameterSpace
    simulate: Simulator
    draw: Callable[[Float[Tensor, " D"], int, torch.Generator], Float[Tensor, "N P"]]
    truth: tuple[float, ...] | None = None

    def within(self, propose: Callable[[int], Tensor], number: int) -> Float[Tensor, "N P"]:
        """So many of the proposals as lie inside the box."""
        kept: list[Tensor] = []
        while sum(len(part) for part in kept) < number:
            theta = propose(4 * number)
            kept.append(theta[((theta >= self.space.low) & (theta <= self.space.high)).all(-1)])
        return torch.cat(kept)[:number]


def box(size: int, half: float) -> ParameterSpace:
    """Parameters p0, p1, ... within +-half."""
    return ParameterSpace({f"p{i}": Parameter(-half, half, "") for i in range(size)})


def linear(size: int, truth: tuple[float, ...] | None = None) -> KnownTask:
    """x ~ N(theta, .1 I)."""
    sd = math.sqrt(0.1)

    def simulate(theta: Tensor, generator: torch.Generator) -> Tensor:
        return theta + sd * torch.randn(theta.shape, dtype=theta.dtype, generator=generator)

    def draw(x: Tensor, number: int, generator: torch.Generator) -> Tensor:
        # One coordinate at a time: together hardly any of ten would lie in the box.
        one = KnownTask(box(1, 1.0), simulate, draw)

        def coordinate(value: Tensor) -> Tensor:
            return one.within(lambda n: simulate(value.expand(n, 1), generator), number)

        return torch.cat([coordinate(value) for value in x], dim=1)

    return KnownTask(box(size, 1.0), simulate, draw, truth)


def gaussian_mixture() -> KnownTask:
    """Half of the x are sharp, half are not; nothing says which."""

    def simulate(theta: Tensor, generator: torch.Generator) -> Tensor:
        sharp = torch.rand(len(theta), 1, generator=generator) < 0.5
        noise = torch.randn(theta.shape, dtype=theta.dtype, generator=generator)
        return theta + torch.where(sharp, 0.1, 1.0) * noise

    def draw(x: Tensor, number: int, generator: torch.Generator) -> Tensor:
        return task.within(lambda n: simulate(x.expand(n, -1), generator), number)

    task = KnownTask(box(2, 10.0), simulate, draw)
    return task


def two_moons() -> KnownTask:
    """Two crescents."""

    def crescent(number: int, generator: torch.Generator) -> Tensor:
        angle = math.pi * (torch.rand(number, dtype=torch.float64, generator=generator) - 0.5)
        radius = 0.1 + 0.01 * torch.randn(number, dtype=torch.float64, generator=generator)
        return torch.stack([radius * angle.cos() + 0.25, radius * angle.sin()], dim=-1)

    def simulate(theta: Tensor, generator: torch.Generator) -> Tensor:
        first, second = theta.unbind(-1)
        shift = torch.stack([-(first + second).abs(), second - first], dim=-1) / math.sqrt(2)
        return crescent(len(theta), generator) + shift

    def draw(x: Tensor, number: int, generator: torch.Generator) -> Tensor:
        def propose(n: int) -> Tensor:
            shift = x - crescent(n, generator)
            sign = torch.where(torch.rand(n, generator=generator) < 0.5, -1.0, 1.0)
            total, difference = -math.sqrt(2) * shift[:, 0] * sign, math.sqrt(2) * shift[:, 1]
            theta = torch.stack([total - difference, total + difference], dim=-1) / 2
            return theta[shift[:, 0] <= 0]

        return task.within(propose, number)

    task = KnownTask(box(2, 1.0), simulate, draw)
    return task


def slcp() -> KnownTask:
    """Simple likelihood, complex posterior: four modes, for two of the parameters are squared."""
    first, walks, steps = 1_000_000, 0.3, 400

    def covariance(theta: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return theta[:, 2].square(), theta[:, 3].square(), theta[:, 4].tanh()

    def simulate(theta: Tensor, generator: torch.Generator) -> Tensor:
        s1, s2, rho = covariance(theta)
        noise = torch.randn(len(theta), 4, 2, dtype=theta.dtype, generator=generator)
        a = s1[:, None] * noise[..., 0]
        b = s2[:, None] * (rho[:, None] * noise[..., 0] + (1 - rho.square()).sqrt()[:, None] * noise[..., 1])
        return (theta[:, None, :2] + torch.stack([a, b], dim=-1)).flatten(1)

    def log_likelihood(theta: Tensor, x: Tensor) -> Tensor:
        s1, s2, rho = (value.clamp_min(1e-12) if i < 2 else value for i, value in enumerate(covariance(theta)))
        a, b = ((x.view(4, 2) - theta[:, None, :2]) / torch.stack([s1, s2], dim=-1)[:, None]).unbind(-1)
        left = (1 - rho.square()).clamp_min(1e-12)
        square = (a.square() - 2 * rho[:, None] * a * b + b.square()) / left[:, None]
        return -0.5 * square.sum(1) - 4 * (s1.log() + s2.log() + 0.5 * left.log())

    def draw(x: Tensor, number: int, generator: torch.Generator) -> Tensor:
        start = 6 * torch.rand(first, 5, dtype=torch.float64, generator=generator) - 3
        weight = torch.softmax(log_likelihood(start, x), dim=0)
        theta = start[torch.multinomial(weight, number, replacement=True, generator=generator)]
        level = log_likelihood(theta, x)
        for _ in range(steps):
            # Scales of all sizes: the modes are narrow and the ridges long.
            size = walks * 10 ** (-2 * torch.rand(number, 1, dtype=torch.float64, generator=generator))
            moved = theta + size * torch.randn(number, 5, dtype=torch.float64, generator=generator)
            proposed = torch.where((moved.abs() <= 3).all(-1), log_likelihood(moved, x), -torch.inf)
            taken = torch.rand(number, dtype=torch.float64, generator=generator).log() < proposed - level
            theta, level = torch.where(taken[:, None], moved, theta), torch.where(taken, proposed, level)
        signs = torch.where(torch.rand(number, 2, generator=generator) < 0.5, -1.0, 1.0)
        return torch.cat([theta[:, :2], theta[:, 2:4] * signs, theta[:, 4:]], dim=1)

    return KnownTask(box(5, 3.0), simulate, draw)


TASKS: dict[str, KnownTask] = {
    "linear Gaussian, 2": linear(2),
    "linear Gaussian, 10": linear(10),
    "edge": linear(2, (0.98, 0.98)),
    "Gaussian mixture": gaussian_mixture(),
    "two moons": two_moons(),
    "SLCP": slcp(),
}
