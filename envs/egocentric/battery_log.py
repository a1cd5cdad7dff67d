"""A battery's log: what a phone's gauge read, and how much the camera ran between two readings.

    o_k = c(t_k) + e_k [mAh],    a_k the camera's share of the time from t_k to t_k+1

The currents are in how fast the charge falls with the camera and without it. Where readings are missing, nobody knows
what the camera did: the log falls into stretches, which begin anew with their own first reading.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Generator, Tensor
from torchrl.data import Bounded

from envs.egocentric.phone import CAPACITY
from envs.egocentric.sequences import rows_of
from onlinebayes.runs import BadInput, write_atomic
from onlinebayes.simulators import Task

COLUMNS = ("time", "charge", "camera")
"""[s], [mAh], share in [0, 1]."""


class BatteryLog(Task):
    """A phone that is used somehow: the observation is the charge [mAh], the action the camera's share of the step.

    Args:
        horizon: steps of a log.
        charge: at the start, uniform between these [mAh].
    """

    observation_size = 1
    channels: Mapping[str, Mapping[str, str]] = {"observation": {"charge": "mAh"}, "action": {"camera's share": ""}}

    def __init__(self, horizon: int = 20, charge: tuple[float, float] = (CAPACITY / 2, CAPACITY)) -> None:
        self.horizon, self.charge = horizon, charge
        self.action_spec = Bounded(0.0, 1.0, shape=(1,), dtype=torch.float32)

    def start(self, theta: Float[Tensor, "n P"], generator: Generator) -> TensorDict:
        """Charged somehow."""
        low, high = self.charge
        share = torch.rand(len(theta), 1, dtype=theta.dtype, generator=generator, device=theta.device)
        return TensorDict({"qpos": low + (high - low) * share}, (len(theta),), device=theta.device)

    def observe(self, state: TensorDictBase) -> Float[Tensor, "N 1"]:
        """The charge [mAh]."""
        return state.get("qpos").float()

    def command(self, action: Tensor) -> Float[Tensor, "N 1"]:
        """The camera's share."""
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Float[Tensor, " N"]:
        """None: a log is not judged."""
        return torch.zeros(state.batch_size, device=state.device)

    def terminated(self, state: TensorDictBase) -> Bool[Tensor, " N"]:
        """When the battery is empty."""
        return state.get("qpos").squeeze(-1) <= 0


def charge_state(observation: Float[Tensor, "M 1"]) -> TensorDict:
    """The phone's state behind a reading of its gauge."""
    return TensorDict({"qpos": observation.double()}, observation.shape[:1])


def read_battery_log(path: str | Path, dt: float) -> TensorDict:
    """The stretches (n, T) of a log without a gap, padded to one length, as an estimator is conditioned on them.

    Args:
        path: a table with the columns ``time`` [s], ``charge`` [mAh] and ``camera``, the share of the time until the
            next row in which the camera runs. A row whose charge is empty is a gap.
        dt: time between two rows [s]; rows farther apart have a gap between them.

    Raises:
        BadInput: the file or a column is missing, a value cannot be, rows are closer than ``dt``, the charge rises
            over a stretch, or there are no two rows without a gap between them.
    """
    rows = [_numbers(row, line, path) for line, row in enumerate(rows_of(Path(path), COLUMNS), 2)]
    stretches: list[list[tuple[float, float, float]]] = [[]]
    for row in rows:
        last = stretches[-1][-1] if stretches[-1] else None
        if last is not None and row[0] < last[0] + 0.9 * dt:
            raise BadInput(
                f"rows {last[0]:g} and {row[0]:g} s are closer than {dt:g} s",
                f"sort the log, and give a row every {dt:g} s",
                where=str(path),
            )
        if math.isnan(row[1]) or (last is not None and row[0] > last[0] + 1.1 * dt):
            stretches.append([])
        if not math.isnan(row[1]):
            stretches[-1].append(row)
    whole = [torch.tensor(stretch) for stretch in stretches if len(stretch) > 1]
    if not whole:
        raise BadInput(
            f"no two rows are {dt:g} s apart", "give the log's own step, or a log with fewer gaps", where=str(path)
        )
    for stretch in whole:
        if bool(stretch[-1, 1] > stretch[0, 1]):
            raise BadInput(
                f"the charge rises from {float(stretch[0, 0]):g} to {float(stretch[-1, 0]):g} s",
                "leave out the time on the charger",
                where=str(path),
            )
    return _padded(whole)


def write_battery_log(path: str | Path, log: TensorDictBase, dt: float, missing: Bool[Tensor, " T"]) -> None:
    """One trajectory (T,) of :class:`BatteryLog` as a table, without the rows that are ``missing``."""
    charge = [*log["observation"][:, 0].tolist(), float(log["next", "observation"][-1, 0])]
    camera = [*log["action"][:, 0].tolist(), 0.0]
    gone = [*missing.tolist(), False]
    rows = [
        f"{k * dt:g},{c:.3f},{u:.4f}"
        for k, (c, u, left_out) in enumerate(zip(charge, camera, gone, strict=True))
        if not left_out
    ]
    write_atomic(Path(path), "\n".join([",".join(COLUMNS), *rows]) + "\n")


def _numbers(row: list[str], line: int, path: str | Path) -> tuple[float, float, float]:
    """Time, charge (nan where it is empty) and share."""
    try:
        time, charge, camera = float(row[0]), float(row[1] or "nan"), float(row[2] or "nan")
    except ValueError:
        time = charge = camera = math.inf
    if not math.isfinite(time) or math.isinf(charge) or charge < 0 or not (0 <= camera <= 1 or math.isnan(charge)):
        raise BadInput(
            f"row {line}: {', '.join(row)}",
            "needs a time [s], a charge [mAh] or nothing, and a share of camera in 0..1",
            where=str(path),
        )
    return time, charge, camera


def _padded(stretches: list[Tensor]) -> TensorDict:
    steps = max(len(stretch) for stretch in stretches) - 1
    table = torch.zeros(len(stretches), steps + 1, 3)
    for place, stretch in zip(table, stretches, strict=True):
        place[: len(stretch)] = stretch
        place[len(stretch) :] = stretch[-1]
    there = torch.arange(steps) < torch.tensor([len(stretch) - 1 for stretch in stretches])[:, None]
    charge, camera = table[..., 1:2], table[..., 2:]
    told = {"observation": charge[:, :-1], "action": camera[:, :-1], "next": {"observation": charge[:, 1:]}}
    return TensorDict({**told, "mask": there}, (len(stretches), steps))
