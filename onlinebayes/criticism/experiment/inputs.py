"""The family of inputs that are tried: for every actuator alone and for all together, from every start posture.

    u(t) = u0 + a w(t) s(t),     s one of chirps, steps, stairs, a slow triangle, sums of sines;  w(0) = w(T) = 0

u0 is the command that holds the posture (see :mod:`.postures`), a the largest amplitude that the limits leave. w rises
and falls as a raised cosine, so that the machine is never jolted. The second form of a shape is balanced: a constant
and a ramp are taken from it so that its integral and double integral vanish, which brings a free mass back to where it
was, at rest. Edges of steps are as long as the rate allows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.criticism.experiment.limits import Limits
from onlinebayes.identification.data.windows import Windows

TAPER = 0.1  # of the length, at most one horizon


@dataclass(frozen=True)
class Posture:
    """A start at rest.

    Args:
        name: what to add to an input's name; empty for the first.
        start: q0 of the J joints [m, rad].
        held: u0 of the U commands [command units].
    """

    name: str
    start: Float[Tensor, " J"]
    held: Float[Tensor, " U"]


@dataclass(frozen=True)
class Inputs:
    """N inputs of K rows for U actuators, each from rest in a posture of J joints.

    Args:
        names: what each is, in words.
        step: spacing of the rows [s].
        command: held from each row until the next [command units].
        start: posture [m, rad].
        held: command that holds the posture [command units].
        scale: share of the largest amplitude that was left of each.
    """

    names: tuple[str, ...]
    step: float
    command: Float[Tensor, "N K U"]
    start: Float[Tensor, "N J"]
    held: Float[Tensor, "N U"]
    scale: Float[Tensor, " N"]

    @property
    def count(self) -> int:
        """Number of inputs N."""
        return len(self.names)

    def select(self, index: Int[Tensor, " V"]) -> Inputs:
        """Some of the inputs."""
        rows = {name: getattr(self, name)[index] for name in ("command", "start", "held", "scale")}
        return replace(self, names=tuple(self.names[i] for i in index.tolist()), **rows)

    def scaled(self, factor: Float[Tensor, " N"]) -> Inputs:
        """Each input nearer to its held command by a factor."""
        held = self.held[:, None]
        return replace(self, command=held + factor[:, None, None] * (self.command - held), scale=self.scale * factor)


def admissible_inputs(
    windows: Windows, limits: Limits, names: tuple[str, ...], postures: Sequence[Posture], most: int = 96
) -> Inputs:
    """All inputs, within the bounds of the commands and their rates.

    Args:
        windows: of the measured runs; give the clock and the horizon.
        limits: what is admissible.
        names: of the U actuators.
        postures: where inputs begin and end, each held by a command within the bounds.
        most: number of inputs; of more, every so many-th is taken.
    """
    rows = max(2, round(limits.seconds / windows.step)) + 1
    t = torch.arange(rows, dtype=windows.start.dtype, device=windows.start.device) * windows.step
    found = []
    for posture in postures:
        place, start, held = posture.name, posture.start, posture.held
        for actuators in _together(limits):
            who = names[actuators[0]] if len(actuators) == 1 else "all"
            for what, shape in _shapes(t, windows.horizon, _edges(limits, actuators), len(actuators)):
                command = held.expand(rows, -1).clone()
                for column, k in enumerate(actuators):
                    reach = torch.maximum(limits.command_high[k] - held[k], held[k] - limits.command_low[k])
                    command[:, k] = held[k] + reach * shape[:, column]
                clipped = torch.minimum(torch.maximum(command, limits.command_low), limits.command_high)
                label = f"{who}: {what}" if len(names) > 1 else what
                found.append((f"{label}{place}", clipped, start, held))
    stride = math.ceil(len(found) / most)
    kept = found[::stride]
    inputs = Inputs(
        tuple(label for label, _, _, _ in kept),
        windows.step,
        torch.stack([command for _, command, _, _ in kept]),
        torch.stack([start for _, _, start, _ in kept]),
        torch.stack([held for _, _, _, held in kept]),
        windows.start.new_ones(len(kept)),
    )
    return _slow_enough(inputs, limits)


def _slow_enough(inputs: Inputs, limits: Limits) -> Inputs:
    """Nearer to the held command, which lies within the bounds, as far as the rates ask."""
    rate = (inputs.command[:, 1:] - inputs.command[:, :-1]).abs().amax(1) / inputs.step
    return inputs.scaled((limits.rate / rate.clamp_min(1e-300)).amin(1).clamp_max(1.0))


def _together(limits: Limits) -> list[tuple[int, ...]]:
    """Each actuator that may be commanded alone, and all of them."""
    usable = [k for k in range(len(limits.rate)) if float(limits.command_high[k] - limits.command_low[k]) > 0]
    return [*((k,) for k in usable), *([tuple(usable)] if len(usable) > 1 else [])]


def _edges(limits: Limits, actuators: tuple[int, ...]) -> float:
    """Seconds that a cosine edge from bound to bound needs at the slowest actuator's rate."""
    width = limits.command_high - limits.command_low
    return max(float(0.5 * math.pi * width[k] / limits.rate[k].clamp_min(1e-300)) for k in actuators)


def _shapes(t: Float[Tensor, " K"], horizon: float, edge: float, count: int) -> Iterator[tuple[str, Tensor]]:
    """Name and values (K, count) of every shape, at most 1 in size, zero at both ends; several actuators move apart."""
    window = _window(t, horizon)
    for name, balanced, make in _makers(t, horizon, edge):
        raw = torch.stack([make(k) for k in range(count)], -1) * window[:, None]
        yield name, raw / raw.abs().amax().clamp_min(1e-12)
        if balanced:
            level = torch.stack([_balance(raw[:, k], window, t) for k in range(count)], -1)
            yield f"{name}, balanced", level / level.abs().amax().clamp_min(1e-12)


def _makers(t: Float[Tensor, " K"], horizon: float, edge: float) -> Iterator[tuple[str, bool, Callable[[int], Tensor]]]:
    """(name, whether also balanced, shape of the k-th actuator) for the whole family."""
    T, H, step = float(t[-1]), horizon, float(t[1] - t[0])
    fastest = min(4 / H, 0.1 / step)

    def chirp(k: int, low: float, high: float) -> Tensor:
        x = t / T if k % 2 == 0 else 1 - t / T
        ratio = high / low
        return torch.sin(2 * math.pi * low * T * (ratio**x - 1) / math.log(ratio) + 0.9 * k)

    def steps(k: int, dwell: float) -> Tensor:
        return _smooth(torch.where(((t + 0.4 * k * dwell) / dwell).floor() % 2 == 0, 1.0, -1.0).to(t), edge, step)

    def stairs(k: int) -> Tensor:
        levels = t.new_tensor([0.35, 0.7, 1.0, 0.7, 0.35, -0.35, -0.7, -1.0, -0.7, -0.35])
        return _smooth(levels[((t / T * 10).long().clamp_max(9) + 3 * k) % 10], max(edge, 0.05 * H), step)

    def triangle(k: int, period: float) -> Tensor:
        return 2 / math.pi * torch.asin(torch.sin(2 * math.pi * t / period + 0.9 * k))

    def sines(k: int, low: float, high: float, seed: int) -> Tensor:
        draw = torch.Generator().manual_seed(1000 * seed + k)
        share, phase = torch.rand(2, 5, generator=draw, dtype=torch.float64).to(t)
        frequency = low * (high / low) ** share
        return torch.sin(2 * math.pi * (frequency[:, None] * t + phase[:, None])).sum(0)

    yield "slow chirp", True, partial(chirp, low=1 / T, high=1 / H)
    yield "fast chirp", True, partial(chirp, low=0.5 / H, high=fastest)
    for dwell in (0.5 * H, H, 2.5 * H, T / 4):
        yield f"steps of {dwell:.3g} s", True, partial(steps, dwell=dwell)
    yield "holds", False, stairs
    for period in (T, T / 3):
        yield f"triangle of {period:.3g} s", False, partial(triangle, period=period)
    for seed, (low, high) in enumerate(((1 / T, 0.5 / H), (0.5 / H, 2 / H), (1 / T, fastest))):
        name = f"sines of {low:.2g} to {high:.2g} Hz"
        yield name, True, partial(sines, low=low, high=high, seed=seed)


def _window(t: Float[Tensor, " K"], horizon: float) -> Float[Tensor, " K"]:
    """Raised-cosine rise and fall."""
    rise = min(TAPER * float(t[-1]), horizon)
    edge = torch.minimum(t, t[-1] - t).clamp(0.0, rise) / rise
    return 0.5 - 0.5 * torch.cos(math.pi * edge)


def _smooth(values: Float[Tensor, " K"], seconds: float, step: float) -> Float[Tensor, " K"]:
    """Moving average with a half-sine kernel, which makes an edge a cosine of ``seconds``."""
    half = max(1, round(0.5 * seconds / step))
    offset = torch.arange(-half, half + 1, dtype=values.dtype, device=values.device)
    kernel = torch.cos(0.5 * math.pi * offset / (half + 1))
    padded = torch.cat([values[:1].expand(half), values, values[-1:].expand(half)])
    return torch.nn.functional.conv1d(padded[None, None], (kernel / kernel.sum())[None, None])[0, 0]


def _balance(raw: Float[Tensor, " K"], window: Float[Tensor, " K"], t: Float[Tensor, " K"]) -> Float[Tensor, " K"]:
    """``raw`` less a windowed constant and ramp, with no integral and no double integral left."""
    ramp = t / t[-1] - 0.5
    basis = torch.stack([window, window * ramp], -1)
    moments = torch.stack([torch.ones_like(t), ramp])
    return raw - basis @ torch.linalg.solve(moments @ basis, moments @ raw)
