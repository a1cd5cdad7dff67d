"""Torque commands that move a pendulum informatively: multisines, chirps there and back, and random steps.

    multisine  u = sum_i cos(2 pi f_i t + phi_i) / sqrt(n / 2)       f_i in [0.2, 3] Hz
    chirp      u = cos(2 pi (f_0 t + (f_1 - f_0) t^2 / 2 D))         f_0 to f_1 and back, in D seconds each
    steps      u = L_j,  L_j in [-1, 1], each held 0.25 to 0.9 s

What they are multiplied with is the operator's business. Every run moves in both directions, slowly and fast, so that
a law must hold all over it.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

TONES = 6
QUIET = 0.15  # [s]


def multisine(times: Float[Tensor, " T"], draw: torch.Generator) -> Float[Tensor, " T"]:
    """Six tones of random frequency and phase; root mean square near one."""
    frequency = 0.2 + 2.8 * torch.rand(TONES, 1, generator=draw, dtype=times.dtype)
    phase = 2 * math.pi * torch.rand(TONES, 1, generator=draw, dtype=times.dtype)
    return torch.cos(2 * math.pi * frequency * times + phase).sum(0) / math.sqrt(TONES / 2)


def chirp(times: Float[Tensor, " T"], draw: torch.Generator) -> Float[Tensor, " T"]:
    """From about 0.3 Hz up to about 3 Hz and back down; amplitude one."""
    low, high, phase = torch.rand(3, generator=draw, dtype=times.dtype)
    low, high = 0.2 + 0.2 * low, 2.5 + high
    half = float(times[-1]) / 2
    rate = torch.where(times <= half, low + (high - low) * times / half, high - (high - low) * (times - half) / half)
    cycles = torch.cumsum(rate, 0) * (times[1] - times[0])
    return torch.cos(2 * math.pi * (cycles + phase))


def steps(times: Float[Tensor, " T"], draw: torch.Generator) -> Float[Tensor, " T"]:
    """Random levels in [-1, 1], each held for 0.25 to 0.9 s."""
    count = math.ceil(float(times[-1]) / 0.25) + 1
    ends = torch.cumsum(0.25 + 0.65 * torch.rand(count, generator=draw, dtype=times.dtype), 0)
    levels = 2 * torch.rand(count, generator=draw, dtype=times.dtype) - 1
    return levels[torch.searchsorted(ends, times, right=True)]


SHAPES = (multisine, chirp, steps)


def excitation(runs: int, times: Float[Tensor, " T"], draw: torch.Generator) -> Float[Tensor, "R T"]:
    """Commands of several runs, the shapes in turn, amplitude about one, nothing in the first ``QUIET`` seconds."""
    commands = torch.stack([SHAPES[run % len(SHAPES)](times, draw) for run in range(runs)])
    # Every log begins at rest, longer than any delay: what was commanded before it is no question then.
    return torch.where(times < QUIET, torch.zeros_like(commands), commands)
