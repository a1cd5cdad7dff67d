"""N worlds on one ``mujoco.batch.Batch``: parameters in, states in and out, steps, and who diverged."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, no_type_check

import mujoco
import mujoco.batch
import numpy as np
import torch
from tensordict import TensorDict, TensorDictBase

from onlinebayes.runs import cores, heed
from onlinebayes.simulators.mujoco.host import to_host
from onlinebayes.simulators.mujoco.model import batch_model, quiet
from onlinebayes.simulators.mujoco.stage import INERTIA, ForceStage
from onlinebayes.simulators.mujoco.system import MujocoSystem

_PARENTS: list[mujoco.batch.Batch] = []
"""Batches of processes of which this one is a fork. A batch waits for the end of its threads when it is freed, and a
fork has no threads of its parent's: it would wait for ever."""


class Worlds:
    """N worlds of a system. A row is one world's ``mjSTATE_INTEGRATION``.

    A world fails when the engine warns about it (its state or acceleration is not finite or huge, its constraints
    overflow) or raises; it then keeps the row it had and is not stepped until it is written anew.

    Args:
        system: the compiled system.
        worlds: N.
        threads: 0 for all cores that this process may use.

    Attributes:
        failed: (N,) bool.
        stage: the force stage, or None without staged effects.
        trace: its hidden states after each timestep that :meth:`record` has recorded.
    """

    def __init__(self, system: MujocoSystem, worlds: int, threads: int = 0) -> None:
        self.system, self.worlds = system, worlds
        self.batch = mujoco.batch.Batch(batch_model(system.model), worlds, threads or cores())
        self.failed = np.zeros(worlds, dtype=bool)
        self._fields = {name: self.batch.expand(name) for name in system.fields}
        # The parts of the state are the first columns of a row, in the record's order.
        self._record = self.batch.state[:, : system.record.size]
        self._rest = self.batch.state[0].copy()
        self._ctrl = self.batch.bind("ctrl")
        # Limits of the actuators' forces while they are on.
        self._range = np.repeat(system.model.actuator_forcerange[None], worlds, axis=0)
        self._on, self._all_on = np.ones((worlds, len(system.commands)), dtype=bool), True
        self.trace: list[dict[str, TensorDict]] = []
        changed = INERTIA if any(effect.changes_inertia for effect in system.staged) else ()
        weighed = {name: self.batch.expand(name) for name in changed}
        fields = {**self._fields, **weighed}
        self.stage = ForceStage(system, self.batch, fields, worlds) if system.staged else None
        # An output is copied out from the call on before which it was bound.
        self._sensors = self.batch.bind("sensordata") if system.sensors else None
        self._qacc = self.batch.bind("qacc") if self.stage is not None and self.stage.halves else None
        self._process = os.getpid()

    @no_type_check  # which a process at its end no longer can
    def __del__(self) -> None:
        if getattr(self, "_process", None) not in (None, os.getpid()):
            _PARENTS.append(self.batch)

    # --- writing ------------------------------------------------------------------------------------------------

    def write_theta(self, theta: np.ndarray, ids: np.ndarray | None = None) -> None:
        """Write the parameters theta (n, P) into the worlds ``ids`` (all without); constants follow."""
        rows = slice(None) if ids is None else ids
        for name, values in self.system.write(theta).items():
            self._fields[name][rows] = values.reshape(len(theta), *self._fields[name].shape[1:])
            if name == "actuator_forcerange":
                self._range[rows] = values
        if self.stage is not None:
            self.stage.write_theta(theta, ids)
        if self.system.needs_const:
            self._run(self.batch.set_const, ids)
        if self.stage is not None:
            self.stage.keep(ids)
        if not self._all_on:
            self._switch(self._on)

    def write_state(self, state: TensorDictBase | None, ids: np.ndarray | None = None) -> None:
        """Start the worlds ``ids`` (all without) from their rows of ``state`` (N,); parts it lacks are the defaults."""
        rows = slice(None) if ids is None else ids
        self.batch.state[rows] = self._rest
        for key, columns in self.system.record.columns.items():
            value = None if state is None else state.get(key, None)
            if value is not None:
                self._record[rows, columns] = to_host(value)[rows]
        self.batch.warning[rows] = 0

    def revive(self, ids: np.ndarray | None = None) -> None:
        """The worlds ``ids`` (all without) have not failed."""
        self.failed[slice(None) if ids is None else ids] = False

    def begin_again(self, failed: np.ndarray) -> None:
        """Stand as new worlds do, but for theta, which stays; ``failed`` (N,) are those that refused it."""
        self.failed[:] = failed
        self.write_enable(None)
        self.trace = []

    def write_enable(self, enable: np.ndarray | None) -> None:
        """Switch actuators: enable (N, U), None for all on. Off means that the actuator gives no force."""
        if enable is None and self._all_on:
            return
        on = np.ones_like(self._on) if enable is None else enable > 0
        if not np.array_equal(on, self._on):
            self._switch(on)

    def _switch(self, on: np.ndarray) -> None:
        """An actuator that is off has its force limited to [0, 0]; MuJoCo treats every kind of actuator alike there."""
        model = self.system.model
        limited, bounds = self.batch.expand("actuator_forcelimited"), self.batch.expand("actuator_forcerange")
        for column, command in enumerate(self.system.commands):
            i, active = command.actuator, on[:, column]
            limited[:, i] = np.where(active, model.actuator_forcelimited[i], 1)
            bounds[:, i] = np.where(active[:, None], self._range[:, i], 0.0)
        self._on, self._all_on = on.copy(), bool(on.all())

    def snapshot(self) -> dict[str, torch.Tensor]:
        """Rows of all worlds, who failed, and which actuators are on."""
        return {
            "rows": torch.from_numpy(self.batch.state.copy()),
            "failed": torch.from_numpy(self.failed.copy()),
            "on": torch.from_numpy(self._on.copy()),
        }

    def restore(self, snapshot: Mapping[str, Any]) -> None:
        """Write rows, failures and switches; theta is written before."""
        self.batch.state[:] = snapshot["rows"].numpy()
        self.batch.warning[:] = 0
        self.failed[:] = snapshot["failed"].numpy()
        self.write_enable(snapshot["on"].numpy().astype(float))

    # --- reading ------------------------------------------------------------------------------------------------

    def read_state(self) -> TensorDict:
        """A copy of the states, batch size (N,)."""
        rows = torch.from_numpy(self._record.copy())
        state = TensorDict(self.system.record.unpack(rows), batch_size=[self.worlds])
        if self.system.sensors:
            state["sensor"] = torch.from_numpy(self.read_sensors())
        return state

    def read_sensors(self) -> np.ndarray:
        """Read the sensors among the signals at the present states (N, n); the states stay as they are."""
        before = self.batch.state.copy()
        self._run(self.batch.forward, self._alive())
        assert self._sensors is not None
        sensors = np.array(self._sensors)[:, list(self.system.sensor_places)]
        self.batch.state[...] = before
        return sensors

    def put(self, key: str, columns: Sequence[int], value: float) -> None:
        """Write one number into columns of a part of the state of every world that has not failed."""
        rows, part = self._alive(), self.system.record.columns[key]
        places = [part.start + column for column in columns]
        if rows is None:
            self._record[:, places] = value
        else:
            self._record[np.ix_(rows, places)] = value

    def look(self) -> None:
        """Bring what follows from positions and velocities alone (``xpos``, ``cvel``) up to the present states."""
        self._run(partial(self.batch.forward, stage=mujoco.mjtStage.mjSTAGE_VEL), None)

    # --- running ------------------------------------------------------------------------------------------------

    def hold(self, ctrl: np.ndarray, steps: int) -> None:
        """``steps`` timesteps under one ctrl (N, nu)."""
        before = self._record.copy()
        self._ctrl[...] = ctrl
        self._run(partial(self.batch.step, nstep=steps), self._alive())
        self._settle(before)

    def follow(self, ctrl: np.ndarray) -> None:
        """One timestep for each row of ctrl (N, K, nu)."""
        before = self._record.copy()
        for k in range(ctrl.shape[1]):
            self._ctrl[...] = ctrl[:, k]
            self._step_once()
        self._settle(before)

    def _step_once(self) -> None:
        """One timestep, after the force stage where there is one."""
        alive = self._alive()
        if self.stage is not None:
            self.stage.apply(self._on, alive)
            if self.stage.halves:
                self.stage.apply_halfway(self._acceleration(alive))
        self._run(self.batch.step, alive)

    def _acceleration(self, alive: np.ndarray | None) -> torch.Tensor:
        """Of every world at its present state (N, nv), which stays as it is."""
        before = self.batch.state.copy()
        self._run(self.batch.forward, alive)
        self.batch.state[...] = before
        return torch.from_numpy(np.array(self._qacc))

    def record(self, ctrl: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One timestep for each row of ctrl (N, K, nu), all recorded.

        Returns:
            The recorded rows (N, K, S), laid out by :attr:`MujocoSystem.record`, and how many of them are good (N,).
        """
        if self.stage is not None:
            return self._record_staged(ctrl)
        spec, size = self.system.record.bits, self.system.record.size
        steps, alive = ctrl.shape[1], self._alive()
        count = self.worlds if alive is None else len(alive)
        rows = {spec: np.zeros((count, steps, size))}
        control = None
        if ctrl.shape[2]:
            control = ctrl if alive is None else ctrl[alive]
        run = partial(self.batch.rollout, steps, control, int(mujoco.mjtState.mjSTATE_CTRL), [spec], out=rows)
        raised = self._run(lambda ids=None: run(ids=ids), alive)
        good = np.full(self.worlds, steps)
        recorded = rows[spec]
        if alive is not None:
            recorded = np.zeros((self.worlds, steps, size))
            recorded[alive], good[self.failed] = rows[spec], 0
        # A world stops at the step that warned: time, the first column, stands still from there on.
        stopped = self.batch.warning[:, :, 1].any(1) & ~self.failed
        clock = recorded[stopped, :, 0]
        good[stopped] = (clock == clock[:, -1:]).argmax(1)
        good[raised] = 0
        wild = ~np.isfinite(recorded[:, -1]).all(1) & ~stopped
        good[wild] = np.minimum(good[wild], (~np.isfinite(recorded[wild]).all(2)).argmax(1))
        self.failed |= good < steps
        return recorded, good

    def _record_staged(self, ctrl: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """:meth:`record` with a force stage: step by step, and the hidden states after each into ``trace``."""
        assert self.stage is not None
        steps = ctrl.shape[1]
        recorded, good = np.empty((self.worlds, steps, self._record.shape[1])), np.full(self.worlds, steps)
        good[self.failed] = 0
        before = self._record.copy()
        for k in range(steps):
            heed()
            self._ctrl[...] = ctrl[:, k]
            self._step_once()
            self._settle(before)
            if self.failed.any():
                good[self.failed & (good == steps)] = k
            before = recorded[:, k]
            before[...] = self._record
            self.trace.append(dict(self.stage.hidden))
        wild = ~np.isfinite(recorded[:, -1]).all(1) & ~self.failed
        good[wild] = np.minimum(good[wild], (~np.isfinite(recorded[wild]).all(2)).argmax(1))
        self.failed |= good < steps
        return recorded, good

    def _alive(self) -> np.ndarray | None:
        return np.flatnonzero(~self.failed).astype(np.int32) if self.failed.any() else None

    def _run(self, call: Callable[..., object], ids: np.ndarray | None) -> np.ndarray:
        """Run a batch call; worlds in which the engine raised fail. Returns their ids."""
        try:
            with quiet():
                call(ids=ids)
        except mujoco.batch.SimulationError as error:
            self.failed[error.ids] = True
            return error.ids
        return np.zeros(0, dtype=np.int32)

    def _settle(self, before: np.ndarray) -> None:
        """Worlds that have just failed get back the row they had."""
        warned = self.batch.warning[:, :, 1]
        if warned.any() or self.failed.any():
            failed = self.failed | warned.any(1)
            self._record[failed] = before[failed]
            self.batch.warning[failed] = 0
            self.failed = failed
