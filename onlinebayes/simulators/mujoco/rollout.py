"""Trajectories of M worlds from given states under given commands, all timesteps inside the engine.

Row k of the inputs is spread over the whole timesteps from ``times[k-1]`` to ``times[k]``, command stages run over the
whole sequence at once, and the states at ``times`` are picked from the recorded timesteps. With a force stage the
timesteps are walked one by one.
"""

from __future__ import annotations

import itertools

import numpy as np
import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.runs import BadInput, cores, heed
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.reused import worlds_at
from onlinebayes.simulators.mujoco.system import MujocoSystem
from onlinebayes.simulators.mujoco.worlds import Worlds

MEMORY = 2**26
"""Numbers that controls and records of one engine call may take together (512 MiB); more worlds go in several calls."""

STEPS = 2**16
"""Timesteps of all worlds together in one engine call, between two looks whether the work is to end: a second or two of
a machine with contacts."""


def rollout(
    system: MujocoSystem,
    threads: int,
    theta: Float[Tensor, "M P"],
    state: TensorDictBase,
    inputs: TensorDictBase,
    times: Float[Tensor, " T"],
) -> TensorDict:
    """See :meth:`onlinebayes.simulators.base.Simulator.rollout`."""
    if not len(theta) == len(state) == len(inputs) or inputs.batch_size[1:] != times.shape:
        shape = " x ".join(str(n) for n in inputs.batch_size)
        raise BadInput(
            f"theta has {len(theta)} rows, state {len(state)}, inputs {shape}, times {len(times)}",
            "give one row of theta, state and inputs a world, and one column of inputs an instant",
        )
    marks = _marks(times, system.model.opt.timestep)
    width = system.model.nu + system.record.size + len(system.sensors)
    per_world = max(1, int(marks[-1])) * width
    # Every thread has a world to step, however long the rollout.
    busy = max(STEPS // max(1, int(marks[-1])), threads or cores())
    chunk = max(1, min(MEMORY // per_world, busy))
    parts = []
    for i in range(0, len(theta), chunk):
        heed()
        rows = slice(i, i + chunk)
        parts.append(_rollout(system, threads, theta[rows], state[rows], inputs[rows], marks))
    return parts[0] if len(parts) == 1 else torch.cat(parts)


def _marks(times: Tensor, timestep: float) -> np.ndarray:
    """Number of timesteps since the start at which each row is recorded (T,)."""
    if not len(times):
        raise BadInput("times is empty", "give at least one instant")
    marks = np.round(to_host(times.double()) / timestep).astype(np.int64)
    if marks[0] < 0 or (np.diff(marks) < 0).any():
        raise BadInput("times go back", "give instants since the start, increasing")
    return marks


def _rollout(
    system: MujocoSystem,
    threads: int,
    theta: Tensor,
    state: TensorDictBase,
    inputs: TensorDictBase,
    marks: np.ndarray,
) -> TensorDict:
    with worlds_at(system, to_host(theta), threads, int(marks[-1])) as worlds:
        return _of_worlds(worlds, theta, state, inputs, marks)


def _of_worlds(
    worlds: Worlds, theta: Tensor, state: TensorDictBase, inputs: TensorDictBase, marks: np.ndarray
) -> TensorDict:
    system = worlds.system
    worlds.write_state(state)
    before = worlds.read_state()
    start = system.record.pack(before, len(theta))
    if system.sensors:
        start = np.concatenate([start, to_host(before["sensor"])], axis=1)
    row = np.repeat(np.arange(len(marks)), np.diff(marks, prepend=0))
    hidden = system.hidden(state, len(theta))
    if worlds.stage is not None:
        worlds.stage.hidden = {e.key: hidden[e.key] for e in system.staged if e.key in hidden}
    ctrl, _, fed = system.drive(theta, hidden, inputs.get("command")[:, row])
    enable = inputs.get("enable", None)
    recorded, good = _record(worlds, ctrl, None if enable is None else to_host(enable) > 0, row)
    # Row 0 of the line is the start: a world that diverged at step g + 1 stays at row g.
    picked = np.minimum(marks[None], good[:, None])
    states = np.take_along_axis(recorded, np.maximum(picked, 1)[..., None] - 1, axis=1) if len(row) else None
    if states is None:
        states = np.repeat(start[:, None], len(marks), axis=1)
    elif (picked == 0).any():
        states = np.where((picked == 0)[..., None], start[:, None], states)
    trajectory = TensorDict(system.record.unpack(torch.from_numpy(states)), batch_size=[len(theta), len(marks)])
    if system.sensors:
        trajectory["sensor"] = torch.from_numpy(states[..., system.record.size :])
    trajectory["valid"] = torch.from_numpy(marks[None] <= good[:, None])
    for key, trace in system.trace(theta, hidden, fed).items():
        trajectory["effects", key] = _pick(hidden[key], trace, marks)
    for effect in system.staged:
        if effect.key in hidden:
            trajectory["effects", effect.key] = _pick_stage(hidden[effect.key], worlds.trace, effect.key, marks)
    return trajectory


def _record(
    worlds: Worlds, ctrl: np.ndarray, enable: np.ndarray | None, row: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Run all timesteps; where actuators are switched, or sensors read at every row, in stretches between these."""
    sensors = bool(worlds.system.sensors)
    if not len(row):
        return np.zeros((worlds.worlds, 0, 1)), np.zeros(worlds.worlds, int)
    always = enable is None or bool(enable.all())
    if always and not sensors:
        return worlds.record(ctrl)
    on = None if enable is None or always else enable[:, row]
    changes = np.zeros(len(row) - 1, dtype=bool) if on is None else (on[:, 1:] != on[:, :-1]).any((0, 2))
    if sensors:
        changes = changes | (np.diff(row) > 0)
    edges = [0, *(np.flatnonzero(changes) + 1).tolist(), len(row)]
    pieces, good = [], np.zeros(worlds.worlds, dtype=np.int64)
    for begin, end in itertools.pairwise(edges):
        if on is not None:
            worlds.write_enable(on[:, begin])
        piece, count = worlds.record(ctrl[:, begin:end])
        if sensors:  # behind the state, at the stretch's last timestep: the only one that is picked
            read = np.zeros((*piece.shape[:2], len(worlds.system.sensors)))
            read[:, -1] = worlds.read_sensors()
            piece = np.concatenate([piece, read], axis=2)
        pieces.append(piece)
        good += np.where(good == begin, count, 0)
    return np.concatenate(pieces, axis=1), good


def _pick_stage(start: TensorDict, trace: list[dict[str, TensorDict]], key: str, marks: np.ndarray) -> TensorDict:
    """The hidden state of a staged effect after each row."""
    line = [start, *(states[key] for states in trace)]
    return TensorDict.stack([line[mark] for mark in marks.tolist()], dim=1)


def _pick(start: TensorDict, trace: TensorDict, marks: np.ndarray) -> TensorDict:
    """The hidden state after each row: views of the trace where the rows are evenly spaced."""
    size = [len(start), len(marks)]
    strides = np.diff(marks)
    if marks[0] > 0 and (not len(strides) or (strides == strides[0]).all()):
        stride = int(strides[0]) if len(strides) else 1
        if stride > 0:
            return trace.apply(lambda x: x[:, int(marks[0]) - 1 :: stride][:, : len(marks)], batch_size=size)
    index = torch.from_numpy(np.maximum(marks - 1, 0))
    first = torch.from_numpy(marks == 0)

    def pick(before: Tensor, after: Tensor) -> Tensor:
        rows = after[:, index] if after.shape[1] else before[:, None].expand(-1, len(marks), *before.shape[1:])
        shape = (1, -1, *([1] * (before.ndim - 1)))
        return torch.where(first.reshape(shape), before[:, None], rows)

    return start.apply(pick, trace, batch_size=size)
