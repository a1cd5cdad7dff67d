"""Could the model have made this log? Its residual against those that sensor noise alone would leave.

A summary has, for each signal and band of time since a window's start, log RMS of what a fit leaves, in units of the
sensor's noise. The same is made of noise, starts and theta fitted to it to first order, N times; then as in
:mod:`onlinebayes.inference.alarm`. The level of each signal's noise is taken to be known to a fifth: up to 1.2 floors
criticism calls a model adequate.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import BANDS, band_counts, band_squares, left_of
from onlinebayes.inference import Novelty
from onlinebayes.posterior.score import Score

SIMULATED = 200
"""Data sets of noise: p cannot be smaller than a 201st."""

LEVEL = 1.2
"""Factor to which the noise of a sensor is known."""


def surprise(score: Score, generator: torch.Generator) -> tuple[float, int]:
    """P of a residual as strange as this one, and the number of the signal that is strangest."""
    windows, rows = score.windows, score.fitted.rows
    n, S = rows.weight.shape
    made: list[Tensor] = []
    while len(made) < SIMULATED:
        noise = torch.randn(1, windows.count, n, S, generator=generator, dtype=torch.float64).to(rows.residual)
        level = LEVEL ** (2 * torch.rand(S, generator=generator, dtype=torch.float64) - 1)
        # Data of noise alone, in SI, from starts that lie where they were expected.
        seen = noise * level.to(noise) * windows.bin_noise * windows.seen
        full = left_of(windows, rows, seen, windows.start)
        made.append(_summary(score, full[0]))
    found = Novelty(torch.stack(made)).check(_summary(score, rows.residual)[None])
    return found.p, found.farthest[0] % S


def _summary(score: Score, rows: Float[Tensor, "W m"]) -> Float[Tensor, " E"]:
    """Log RMS of every band and signal, zero where nothing was measured."""
    windows = score.windows
    left = score.fitted.rows.in_noise(score.without(rows))
    squares, counts = (x.sum(0) for x in (band_squares(windows, left), band_counts(windows)))
    rms = (squares / counts.clamp_min(1)).sqrt().clamp_min(math.ulp(1.0))
    return torch.where(counts > 0, rms.log(), torch.zeros_like(rms)).reshape(BANDS * windows.noise.shape[0]).double()
