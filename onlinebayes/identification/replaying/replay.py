"""Measured windows played through the simulator, for many thetas and starts in one batched rollout.

    (theta_m, start_mw, commands_w) -> simulated signals (M, W, K, S),   M x W worlds at once

Hidden states of effects are those that the run left before the window. Where they follow from its command and its
measured motion alone (heat), or its command alone (activations), they are worked out along that; see :mod:`.recall`
and :mod:`.commanded`. Others (delay buffers) come from a
forced replay: each world first runs through the commands of the seconds before its window, as many as the effects
remember, then its positions and velocities are set to the window's start and the hidden states kept. Where these follow
from commands alone (filters, delays), worlds of one theta share that run, from wherever they start: it may last many
times a window. Where a parameter changes in time the window is played piece by piece; see :mod:`.timed`.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence

import torch
from jaxtyping import Bool, Float, Int
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.replaying.charted import chart_of
from onlinebayes.identification.replaying.commanded import commanded
from onlinebayes.identification.replaying.extrapolated import coarse_and_fine, extrapolated
from onlinebayes.identification.replaying.instants import read_late
from onlinebayes.identification.replaying.recall import recall
from onlinebayes.identification.replaying.scoped import unfold
from onlinebayes.identification.replaying.timed import pieces
from onlinebayes.runs import heed
from onlinebayes.simulators.abilities import Measured
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.sensing import sense, unsense

CHUNK = 6_000_000  # recorded numbers a rollout may hold
# Parts of a state that a window's start determines.
VISIBLE = frozenset({"qpos", "qvel", "qacc_warmstart", "time", "ctrl", "sensor"})


def replay(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, "M P"],
    starts: Float[Tensor, "M W J2"],
) -> tuple[Float[Tensor, "M W K S"], Bool[Tensor, "M W"]]:
    """Simulated signals at the windows' rows, and whether each world stayed finite over its observed rows.

    A world that diverged holds its last finite values: they are numbers, but its flag is False.
    """
    played = list(_played(simulator, windows, theta, starts))
    return torch.cat([signals for signals, _ in played]), torch.cat([valid for _, valid in played])


def replay_binned(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, "M P"],
    starts: Float[Tensor, "M W J2"],
) -> tuple[Float[Tensor, "M W n S"], Bool[Tensor, "M W"]]:
    """:func:`replay` averaged over the windows' bins; the rows of all worlds are never held at once."""
    played = [(windows.bin(signals), valid) for signals, valid in _played(simulator, windows, theta, starts)]
    return torch.cat([binned for binned, _ in played]), torch.cat([valid for _, valid in played])


def _played(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, "M P"], starts: Float[Tensor, "M W J2"]
) -> Iterator[tuple[Float[Tensor, "m W K S"], Bool[Tensor, "m W"]]]:
    """Signals and flags of :func:`replay`, some thetas at a time."""
    trajectory_width = windows.rows * windows.count * (starts.shape[-1] + len(windows.columns))
    size = max(1, CHUNK // max(trajectory_width, 1))
    needed = windows.observed.any(-1)
    for k in range(0, theta.shape[0], size):
        trajectory = rollout(simulator, windows, theta[k : k + size], starts[k : k + size])
        signals = sensor_readings(simulator, windows, theta[k : k + size], starts[k : k + size], trajectory)
        yield signals, (trajectory["valid"] | ~needed).all(-1) & torch.isfinite(signals).all(-1).all(-1)


def rollout(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, "M P"],
    starts: Float[Tensor, "M W J2"],
) -> TensorDict:
    """The trajectories themselves, batch size (M, W, K). Starts are as the sensors show them; see :mod:`.sensing`."""
    if (two := coarse_and_fine(simulator)) is not None:
        coarse, fine = (rollout(one, windows, theta, starts) for one in two)
        return extrapolated(coarse, fine)
    M, W, K = theta.shape[0], windows.count, windows.rows
    physics, unfolded = unfold(simulator, windows, theta)
    worlds = unfolded.reshape(M * W, -1)
    qpos, qvel = starts.reshape(M * W, -1).chunk(2, dim=-1)
    chart = chart_of(physics, windows)
    state = chart.enter(unsense(physics, worlds, TensorDict({"qpos": qpos, "qvel": qvel}, batch_size=(M * W,))))
    state = chart.physics.project_onto_constraints(state)
    hidden = [key for key in chart.physics.state.keys() if key not in VISIBLE]  # noqa: SIM118  (iterating gives rows)
    recalled = recall(physics, windows, unfolded) if hidden else {}
    given = commanded(chart.physics, windows, unfolded) if set(hidden) - {"effects"} else {}
    remembered = history_rows(chart.physics, windows, {*recalled, *given}) if hidden else 0
    if remembered:
        if given:
            state.update(commanded(chart.physics, windows, unfolded, remembered))
        shared = fed_by_command(chart.physics, recalled).issuperset(hidden)
        every = torch.arange(M, device=theta.device)
        alone, world = distinct(theta) if shared else (every, every)
        of_each = (alone[:, None] * W + torch.arange(W, device=theta.device)).flatten().to(worlds.device)
        before, enable = windows.history[:, -remembered:], windows.history_enable[:, -remembered:]
        past = _drive(chart.physics, worlds[of_each], state[of_each], before, enable, windows.step, len(alone))
        for key in hidden:
            state[key] = past[key][:, -1].unflatten(0, (len(alone), W))[world].flatten(0, 1)
    for key, value in recalled.items():
        state["effects", key] = value
    state.update(given)
    played: list[TensorDict] = []
    for rows in pieces(physics, windows):
        worlds, piece = unfold(simulator, windows, theta, rows)[1].reshape(M * W, -1), slice(*rows)
        command, enable = windows.command[:, piece], windows.enable[:, piece]
        played.append(_drive(chart.physics, worlds, state, command, enable, windows.step, M))
        state = played[-1][:, -1].exclude("valid")
    return chart.leave(_joined(played).reshape(M, W, K))


def _joined(played: Sequence[TensorDict]) -> TensorDict:
    """Pieces of a trajectory as one; what diverged in one is not valid in those after it."""
    if len(played) == 1:
        return played[0]
    trajectory = TensorDict.cat(list(played), dim=1)
    return trajectory.set("valid", trajectory["valid"].long().cummin(1).values.bool())


def history_rows(simulator: Measured, windows: Windows, known: Collection[str] = ()) -> int:
    """Rows before each window that hidden states may remember which are not known; all there are without effects'.

    Force stages are at rest until the run begins, for actuators are off; input stages are fed commands before it too.
    """
    if any(key not in VISIBLE and key != "effects" and key not in known for key in simulator.state.keys()):  # noqa: SIM118
        return windows.history.shape[1]
    rows = 0
    for effect in (effect for effect in simulator.effects if effect.key not in known):
        mine = math.ceil(effect.memory / windows.step)
        rows = max(rows, min(mine, int(windows.first.max())) if effect.has_force else mine)
    return min(rows, windows.history.shape[1])


def fed_by_command(simulator: Identifiable, recalled: Collection[str] = ()) -> frozenset[str]:
    """Parts of a state that are the same from every start: they follow from commands and theta, or were recalled."""
    moved = any(e.has_force and e.remembers and e.key not in recalled for e in simulator.effects)
    return simulator.fed_by_command | (frozenset() if moved else {"effects"})


def distinct(theta: Float[Tensor, "M P"]) -> tuple[Int[Tensor, " m"], Int[Tensor, " M"]]:
    """The first row of each theta there is, and for every row which of these it equals."""
    seen: dict[tuple[float, ...], int] = {}
    world = [seen.setdefault(tuple(row), len(seen)) for row in theta.tolist()]
    alone = torch.tensor([world.index(k) for k in range(len(seen))], device=theta.device)
    return alone, torch.tensor(world, device=theta.device)


def sensor_readings(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, "M P"],
    starts: Float[Tensor, "M W J2"],
    trajectory: TensorDict,
) -> Float[Tensor, "M W K S"]:
    """Read the sensors of :func:`rollout`'s trajectories at their reading times, in the windows' order of signals."""
    simulator, theta = unfold(simulator, windows, theta)
    qpos, qvel = starts.chunk(2, dim=-1)
    state = TensorDict({"qpos": qpos, "qvel": qvel}, batch_size=starts.shape[:2])
    times = windows.step * torch.arange(1, windows.rows + 1, dtype=theta.dtype, device=theta.device)
    signals = sense(simulator, theta, unsense(simulator, theta, state), trajectory, times)
    rows = signals[..., list(windows.columns)]
    return rows if windows.late is None else read_late(rows, windows.late)


def _drive(
    simulator: Simulator,
    theta: Float[Tensor, "N P"],
    state: TensorDict,
    command: Float[Tensor, "W K U"],
    enable: Float[Tensor, "W K U"],
    step: float,
    copies: int,
) -> TensorDict:
    heed()
    W, K, _ = command.shape
    inputs = TensorDict({"command": _repeat(command, copies)}, batch_size=(copies * W, K))
    if not bool((enable == 1).all()):
        inputs["enable"] = _repeat(enable, copies)
    times = torch.arange(1, K + 1, dtype=theta.dtype, device=theta.device) * step
    return simulator.rollout(theta, state, inputs, times)


def _repeat(rows: Float[Tensor, "W K U"], copies: int) -> Float[Tensor, "N K U"]:
    return rows.expand(copies, *rows.shape).flatten(0, 1)
