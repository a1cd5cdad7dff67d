"""Sensitivities of the replay to its parameters and its starts: finite differences, all of them worlds of one rollout.

    simulated(theta + d theta, s + d s) ~ simulated + by_theta d theta + by_start d s

Forward differences, toward the inside of the bounds, with a step of at most a thousandth of a parameter's range: large
against the solver's tolerance, small against what a parameter does. Where bounds are wide, a fit shortens the step to
some standard deviations of the parameter. Parameters that one run alone has are moved in all runs at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.runs import Kept
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

RELATIVE_STEP = 1e-3
START_STEP = 5.0  # of a start's sd
SHORTER = 4  # times that a step may be shortened where the model diverges


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

    @property
    def kept(self) -> Kept:
        """For a memo."""
        return Kept({**vars(self), "valid": torch.tensor(self.valid)})

    @classmethod
    def of(cls, kept: Kept) -> Linearisation:
        """Restore the linearisation that a memo kept."""
        return cls(**{**kept.tensors, "valid": bool(kept.tensors["valid"])})  # type: ignore[arg-type]


def linearise(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    starts: Float[Tensor, "W J2"],
    largest: Float[Tensor, " P"] | None = None,
    shown: Float[Tensor, "W n S"] | None = None,
) -> Linearisation:
    """Replay once at (theta, starts) and once for each parameter and start moved; starts that no window frees stay.

    Args:
        simulator, windows: what is replayed.
        theta, starts: where [SI].
        largest: longest difference step of each parameter [SI]; a thousandth of its range when None.
        shown: the binned replay at (theta, starts), all of it finite, where it is known already [SI].
    """
    steps = parameter_steps(simulator, theta, largest)
    P, world = len(theta), replay_numbers(simulator).to(theta.device)
    Q = int(world.max()) + 1 if P else 0
    moving = windows.free_starts.any(0).nonzero()[:, 0]
    F = len(moving)
    one_by_one = moved_one_by_one(starts, start_steps(windows))[1 + moving]
    moved_starts = torch.cat([one_by_one, starts.expand(Q + 1, *starts.shape)])
    for _ in range(SHORTER):
        moves = theta.new_zeros(Q, P).index_put((world, torch.arange(P, device=theta.device)), steps)
        moved_theta = theta + torch.cat([theta.new_zeros(F, P), moves, theta.new_zeros(1, P)])
        every = len(moved_theta) - (shown is not None)
        binned, valid = replay_binned(simulator, windows, moved_theta[:every], moved_starts[:every])
        stable = valid.all(-1)
        if shown is not None:
            binned, stable = torch.cat([binned, shown[None]]), torch.cat([stable, stable.new_ones(1)])
        if not bool(stable[-1]) or bool(stable.all()):
            break
        # A step that reaches where the model diverges says nothing about where it does not.
        steps = torch.where(stable[F:-1][world], steps, steps / 100)
    moved = (binned[:-1] - binned[-1]).movedim(0, -1)
    by_start = moved.new_zeros(*moved.shape[:-1], starts.shape[1])
    by_start[..., moving] = moved[..., :F] / start_steps(windows)[:, None, None, moving]
    by_theta = moved[..., F:][..., world] / steps
    if isinstance(simulator, ScopedSimulator):
        by_theta = by_theta * simulator.touches(windows).T.to(by_theta)[:, None, None, :]
    return Linearisation(theta, starts, windows.bin(windows.value) - binned[-1], by_start, by_theta, bool(stable.all()))


def central(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    starts: Float[Tensor, "W J2"],
    step: Float[Tensor, " P"],
) -> Float[Tensor, "W n S P"] | None:
    """d simulated / d theta by central differences, one-sided at a bound; None where a world diverges.

    Their error is of second order: what combines parameters so that nothing moves is seen as that.

    Args:
        simulator, windows, theta, starts: as for :func:`linearise`.
        step: of each parameter, half to each side [SI].
    """
    P, world = len(theta), replay_numbers(simulator).to(theta.device)
    if not P:
        return starts.new_zeros(windows.count, windows.bins, len(windows.noise), 0)
    moves = theta.new_zeros(int(world.max()) + 1, P).index_put((world, torch.arange(P, device=theta.device)), step / 2)
    up, down = (simulator.parameters.clamp(theta + sign * moves) for sign in (1, -1))
    moved = between(simulator, windows, down, up, starts)
    if moved is None:
        return None
    width = (up - down)[world, torch.arange(P, device=theta.device)]
    by_theta = moved.movedim(0, -1)[..., world] / width
    if isinstance(simulator, ScopedSimulator):
        by_theta = by_theta * simulator.touches(windows).T.to(by_theta)[:, None, None, :]
    return by_theta


def between(
    simulator: Identifiable,
    windows: Windows,
    down: Float[Tensor, "M P"],
    up: Float[Tensor, "M P"],
    starts: Float[Tensor, "W J2"],
) -> Float[Tensor, "M W n S"] | None:
    """Return the difference of the binned replay between two thetas, pair by pair; None where a world diverges."""
    both = torch.cat([up, down])
    binned, valid = replay_binned(simulator, windows, both, starts.expand(len(both), *starts.shape))
    return binned[: len(up)] - binned[len(up) :] if bool(valid.all()) else None


def linearise_starts(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    starts: Float[Tensor, "W J2"],
    finer: Float[Tensor, " W"] | None = None,
) -> Linearisation:
    """The same with the starts moved alone, each window's by so many times less; derivatives by theta are left zero."""
    step = start_steps(windows) if finer is None else start_steps(windows) / finer[:, None]
    moved = moved_one_by_one(starts, step)
    binned, valid = replay_binned(simulator, windows, theta.expand(len(moved), -1), moved)
    by_start = (binned[1:] - binned[0]).movedim(0, -1) / step[:, None, None, :]
    by_theta = by_start.new_zeros(*by_start.shape[:-1], len(theta))
    return Linearisation(theta, starts, windows.bin(windows.value) - binned[0], by_start, by_theta, bool(valid.all()))


def start_steps(windows: Windows) -> Float[Tensor, "W J2"]:
    """Difference steps of the starts [SI]."""
    return (START_STEP * windows.start_sd).clamp_min(1e-9)


def moved_one_by_one(starts: Float[Tensor, "W J2"], step: Float[Tensor, "W J2"]) -> Float[Tensor, "J21 W J2"]:
    """The starts as they are, then with each coordinate moved by its step [SI]."""
    return torch.cat([starts[None], starts + torch.diag_embed(step).movedim(1, 0)])


def replay_numbers(simulator: Simulator) -> Int[Tensor, " P"]:
    """Number of the moved replay in which each parameter moves: its own one, shared by the own values of all runs."""
    if isinstance(simulator, ScopedSimulator):
        return torch.unique(simulator.place, return_inverse=True)[1]
    return torch.arange(len(simulator.parameters), device=simulator.device)


def parameter_steps(
    simulator: Simulator, theta: Float[Tensor, " P"], largest: Float[Tensor, " P"] | None = None
) -> Float[Tensor, " P"]:
    """Signed difference steps that stay within the bounds [SI]."""
    low, high = simulator.parameters.low.to(theta), simulator.parameters.high.to(theta)
    step = RELATIVE_STEP * (high - low)
    if largest is not None:
        step = torch.minimum(step, largest.clamp_min(1e-6 * step))
    return torch.where(theta + step <= high, step, -step)


def columns(
    simulator: Identifiable,
    windows: Windows,
    base: Float[Tensor, " P"],
    moved: Float[Tensor, "M P"],
    starts: Float[Tensor, "W J2"],
) -> tuple[Float[Tensor, "M W n S"], Float[Tensor, " M"]]:
    """Return the binned replay of each row of ``moved`` less that of ``base``; 1 where all worlds stayed finite."""
    theta = torch.cat([base[None], moved])
    binned, valid = replay_binned(simulator, windows, theta, starts.expand(len(theta), *starts.shape))
    return binned[1:] - binned[0], valid[1:].all(-1).to(base)
