"""How the replay moves with its parameters and its starts: finite differences, all of them worlds of one rollout.

    simulated(theta + d theta, s + d s) ~ simulated + by_theta d theta + by_start d s

Forward differences, toward the inside of the bounds, with a step of a thousandth of a parameter's range: large against
the solver's tolerance, small against what a parameter does.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.replay import replay
from onlinebayes.criticism.windows import Windows
from onlinebayes.simulators.base import Simulator

RELATIVE_STEP = 1e-3
START_STEP = 5.0  # of a start's sd


@dataclass(frozen=True)
class Linearisation:
    """The replay at one theta and its derivatives, in bins: W windows, n bins, S signals, J2 starts, P parameters.

    Args:
        theta: the point [SI].
        starts: of the windows [SI].
        residual: measured - simulated [SI], 0 where nothing was observed.
        by_start: d simulated / d start.
        by_theta: d simulated / d theta.
        valid: whether every world stayed finite.
    """

    theta: Float[Tensor, " P"]
    starts: Float[Tensor, "W J2"]
    residual: Float[Tensor, "W n S"]
    by_start: Float[Tensor, "W n S J2"]
    by_theta: Float[Tensor, "W n S P"]
    valid: bool


def linearise(
    simulator: Simulator, windows: Windows, theta: Float[Tensor, " P"], starts: Float[Tensor, "W J2"]
) -> Linearisation:
    """Replay once at (theta, starts) and once for each parameter and start moved."""
    steps = parameter_steps(simulator, theta)
    J2, P = starts.shape[1], len(theta)
    start_steps = (START_STEP * windows.start_sd).clamp_min(1e-9)
    moved_theta = theta + torch.cat([theta.new_zeros(1 + J2, P), torch.diag(steps)])
    moved_starts = starts.expand(1 + J2 + P, *starts.shape).clone()
    for j in range(J2):
        moved_starts[1 + j, :, j] += start_steps[:, j]
    signals, valid = replay(simulator, windows, moved_theta, moved_starts)
    binned = windows.bin(signals)
    by_start = (binned[1 : 1 + J2] - binned[0]).movedim(0, -1) / start_steps[:, None, None, :]
    by_theta = (binned[1 + J2 :] - binned[0]).movedim(0, -1) / steps
    return Linearisation(theta, starts, windows.bin(windows.value) - binned[0], by_start, by_theta, bool(valid.all()))


def parameter_steps(simulator: Simulator, theta: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    """Signed difference steps that stay within the bounds [SI]."""
    low, high = simulator.parameters.low.to(theta), simulator.parameters.high.to(theta)
    step = RELATIVE_STEP * (high - low)
    return torch.where(theta + step <= high, step, -step)


def columns(
    simulator: Simulator,
    windows: Windows,
    base: Float[Tensor, " P"],
    moved: Float[Tensor, "M P"],
    starts: Float[Tensor, "W J2"],
) -> tuple[Float[Tensor, "M W n S"], Float[Tensor, " M"]]:
    """How the binned replay differs between ``base`` and each row of ``moved``; 1 where all worlds stayed finite."""
    theta = torch.cat([base[None], moved])
    signals, valid = replay(simulator, windows, theta, starts.expand(len(theta), *starts.shape))
    binned = windows.bin(signals)
    return binned[1:] - binned[0], valid[1:].all(-1).to(base)
