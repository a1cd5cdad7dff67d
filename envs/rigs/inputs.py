"""Inputs of a rig: sums of sines, chirps there and back, steps; a shape in turn for each run and actuator.

    sines   u = sum_i cos(2 pi f_i t + phi_i) / sqrt(n / 2)
    chirp   u = cos(2 pi int f dt)                                  f up and back down
    steps   levels in [-1, 1], short ramps between

Every input fades in over half a second, so that a run begins at rest with nothing commanded.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

TONES = 6
FADE = 0.5  # [s]


def inputs(
    times: Float[ndarray, " T"], shape: tuple[int, int], band: tuple[float, float], draw: np.random.Generator
) -> Float[ndarray, "T R m"]:
    """Inputs of R runs and m actuators, of amplitude about one.

    Args:
        times: instants of the rows [s].
        shape: (R, m).
        band: lowest and highest frequency [Hz].
        draw: decides everything.
    """
    runs, actuators = shape
    kinds = (_sines, _chirp, _steps)
    made = [[kinds[(r + a) % 3](times, band, draw) for a in range(actuators)] for r in range(runs)]
    fade = 0.5 - 0.5 * np.cos(np.pi * np.minimum(times / FADE, 1.0))
    # The operator's gain differs from run to run.
    gain = draw.uniform(0.6, 1.0, shape)
    return np.moveaxis(np.array(made), -1, 0) * fade[:, None, None] * gain


def _sines(times: Float[ndarray, " T"], band: tuple[float, float], draw: np.random.Generator) -> Float[ndarray, " T"]:
    f = draw.uniform(*band, TONES)[:, None]
    phase = draw.uniform(0, 2 * np.pi, TONES)[:, None]
    return np.cos(2 * np.pi * f * times + phase).sum(0) / np.sqrt(TONES / 2)


def _chirp(times: Float[ndarray, " T"], band: tuple[float, float], draw: np.random.Generator) -> Float[ndarray, " T"]:
    low, high = band[0] * draw.uniform(1, 2), band[1] * draw.uniform(0.8, 1)
    along = 1 - np.abs(2 * times / times[-1] - 1)
    f = low + (high - low) * along
    cycles = np.concatenate([[0.0], np.cumsum(f[:-1] * np.diff(times))])
    return np.cos(2 * np.pi * (cycles + draw.uniform()))


def _steps(times: Float[ndarray, " T"], band: tuple[float, float], draw: np.random.Generator) -> Float[ndarray, " T"]:
    hold = 0.5 / band[1], 2.0 / band[1]
    ends = np.cumsum(draw.uniform(*hold, int(times[-1] / hold[0]) + 2))
    levels = draw.uniform(-1, 1, len(ends) + 1)
    # Ramps of a fifth of the shortest hold: an operator's controller is spared a jump.
    corners = np.stack([ends, ends + 0.2 * hold[0]], -1).ravel()
    return np.interp(times, corners, np.stack([levels[:-1], levels[1:]], -1).ravel())
