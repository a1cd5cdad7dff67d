r"""How a planner's candidates differ from its present plan: Gaussian sequences of commands, white or smooth.

    e_s = sd F z_s,   z_s ~ N(0, I),   so that   cov(e) = sd^2 F F^T   and every row of F has length 1

A noise is its factor F (H, n). The steps of white noise cancel each other: such candidates hardly differ in where they
lead, and at a low temperature one or two of them carry all the weight. Smooth noise reaches farther with the same sd.

| noise    | F                                                                             |
|----------|-------------------------------------------------------------------------------|
| white    | identity                                                                      |
| knots    | interpolation between n values, evenly spread over the horizon                |
| coloured | cosines and sines of frequency f, weighed with f^(-a / 2): their power is f^(-a) |

Coloured noise: Timmer and Koenig 1995; for planning Pinneri et al. 2020, Sample-efficient Cross-Entropy Method.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import Float
from scipy.interpolate import make_interp_spline
from torch import Tensor

from onlinebayes.runs import BadInput


@runtime_checkable
class Noise(Protocol):
    """Sequences of commands about zero.

    Attributes:
        sd: standard deviation of each command at each step, one for all or one a command [command units].
    """

    @property
    def sd(self) -> float | Sequence[float]:
        """See the class."""

    def factor(self, horizon: int) -> Float[Tensor, "H n"]:
        """F for a number of steps, float64; its rows have length 1."""


@dataclass(frozen=True)
class White:
    """Every step by itself."""

    sd: float | Sequence[float]

    def __post_init__(self) -> None:
        _check_sd(self.sd)

    def factor(self, horizon: int) -> Float[Tensor, "H n"]:
        """See :class:`Noise`."""
        return torch.eye(horizon, dtype=torch.float64)


@dataclass(frozen=True)
class Knots:
    """Interpolated between a few free values.

    Args:
        sd: see :class:`Noise`.
        number: of free values, the first at the first step and the last at the last.
        degree: of the interpolating spline: 1 for straight lines, 3 for a cubic one.
    """

    sd: float | Sequence[float]
    number: int = 5
    degree: int = 1

    def __post_init__(self) -> None:
        _check_sd(self.sd)
        if not 1 <= self.degree < self.number:
            raise BadInput(f"{self.number} knots with a spline of degree {self.degree}", "needs 1 <= degree < knots")

    def factor(self, horizon: int) -> Float[Tensor, "H n"]:
        """See :class:`Noise`."""
        if self.number >= horizon:
            return torch.eye(horizon, dtype=torch.float64)
        places = np.linspace(0, horizon - 1, self.number)
        spline = make_interp_spline(places, np.eye(self.number), k=self.degree)
        return _unit_rows(torch.from_numpy(spline(np.arange(horizon))))


@dataclass(frozen=True)
class Coloured:
    """Power that falls with frequency.

    Args:
        sd: see :class:`Noise`.
        exponent: of the power, f^(-exponent): 0 is white, 1 pink, 2 red.
    """

    sd: float | Sequence[float]
    exponent: float = 2.0

    def __post_init__(self) -> None:
        _check_sd(self.sd)
        if not 0 <= self.exponent < math.inf:
            raise BadInput(f"noise of exponent {self.exponent:g}", "needs 0 <= exponent, 1 for pink and 2 for red")

    def factor(self, horizon: int) -> Float[Tensor, "H n"]:
        """See :class:`Noise`; periods up to twice the horizon, so that the end is free of the beginning."""
        steps = torch.arange(horizon, dtype=torch.float64)[:, None]
        frequencies = torch.arange(1, horizon + 1, dtype=torch.float64) / (2 * horizon)
        angles, power = 2 * math.pi * steps * frequencies, frequencies ** (-self.exponent / 2)
        return _unit_rows(torch.cat((power * angles.cos(), power * angles.sin()), dim=1))


def _unit_rows(factor: Tensor) -> Tensor:
    return factor / torch.linalg.vector_norm(factor, dim=1, keepdim=True)


def _check_sd(sd: float | Sequence[float]) -> None:
    values = torch.as_tensor(sd, dtype=torch.float64)
    if not bool(((values > 0) & values.isfinite()).all()):
        raise BadInput(f"a noise with sd {sd}", "give a positive number in command units, or one for each command")
