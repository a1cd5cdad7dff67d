"""The layout of a recorded state: which parts it has, and where in a row.

| part of the state     | shape   | there when                                                       |
|-----------------------|---------|------------------------------------------------------------------|
| ``"qpos"``, ``"qvel"`` | nq, nv | always                                                           |
| ``"act"``             | na      | actuators have activations                                       |
| ``"history"``, ``"time"`` | n, 1 | the model file itself has delays                                 |
| ``"qacc_warmstart"``  | nv      | always: the constraint solver starts from it, so the future depends on it |
| ``"ctrl"``            | nu      | sensors are signals: those of forces feel the command that is held |
| ``"sensor"``          | n       | sensors are signals (see :mod:`.sensors`); read, never set       |
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.simulators.mujoco.host import to_host

STATE = {
    "time": mujoco.mjtState.mjSTATE_TIME,
    "qpos": mujoco.mjtState.mjSTATE_QPOS,
    "qvel": mujoco.mjtState.mjSTATE_QVEL,
    "act": mujoco.mjtState.mjSTATE_ACT,
    "history": mujoco.mjtState.mjSTATE_HISTORY,
    "qacc_warmstart": mujoco.mjtState.mjSTATE_WARMSTART,
}


@dataclass(frozen=True)
class Record:
    """Layout of one recorded row: which parts of the state, where, and MuJoCo's bits for it; time comes first.

    Args:
        bits: the ``mjtState`` bits of all parts.
        columns: key of the state -> its columns.
        size: width S of a row.
    """

    bits: int
    columns: dict[str, slice]
    size: int

    def unpack(self, rows: Float[Tensor, "*batch S"]) -> dict[str, Tensor]:
        """The parts of a state, sharing the rows' memory."""
        return {key: rows[..., columns] for key, columns in self.columns.items()}

    def pack(self, state: TensorDictBase, worlds: int) -> np.ndarray:
        """Rows (N, S) of a state; time 0."""
        rows = np.zeros((worlds, self.size))
        for key, columns in self.columns.items():
            rows[:, columns] = to_host(state.get(key))
        return rows


def record(model: mujoco.MjModel, sensors: bool) -> Record:
    """The layout for a model; ``sensors``: whether some are signals."""
    # Time matters only to delays, which read their buffers by it; the record always has it, to see who stopped.
    columns, place, bits = {}, 0, 0
    # Sensors of forces depend on the command that is held, which the future does not.
    parts = {**STATE, "ctrl": mujoco.mjtState.mjSTATE_CTRL} if sensors else STATE
    for key, bit in parts.items():
        size = mujoco.mj_stateSize(model, int(bit))
        if key in ("qpos", "qvel") or size > 0:
            bits |= int(bit)
            if key != "time" or model.nhistory:
                columns[key] = slice(place, place + size)
            place += size
    return Record(bits, columns, place)
