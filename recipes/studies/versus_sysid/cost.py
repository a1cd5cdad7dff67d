"""The same parameters fitted to the same windows from the same start: criticism's fit against ``mujoco.sysid``'s.

| which                | what it does                                                                              |
|----------------------|-------------------------------------------------------------------------------------------|
| ours                 | ``identification.fit``: the parameters and the start of every window (projected out)      |
| sysid, starts free   | the same unknowns: :mod:`.free_starts`, all windows in one rollout                        |
| sysid, as documented | fewer: ``ModelSequences``, ``build_residual_fn``: a rollout a window, starts as measured  |
| sysid, by hand       | fewer: the residual of :mod:`.sysid`, all windows in one rollout, starts as measured      |

All on one thread, one after the other, residuals in sensor noise (ours weighs signals and times by the share of their
error). Ours stops where a step promises less than .002 nats of the score; sysid's clock stops at the first iterate
whose objective is within as much of its last one, e^.004, though it goes on.
"""

from __future__ import annotations

import io
import math
import time
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid

from onlinebayes.identification import SETTLED, fit
from recipes.studies.versus_sysid.free_starts import FreeStarts
from recipes.studies.versus_sysid.sysid import Problem
from recipes.studies.versus_sysid.sysid_parameters import Freed, setter
from recipes.studies.versus_sysid.task import Task


def seconds(task: Task) -> tuple[float, float, float, float]:
    """Processor time of ours, and of sysid with starts free, as documented and by hand, from the nominal values [s]."""
    windows, nominal = task.fit_windows, task.simulator.parameters.clamp(task.simulator.nominal)
    began = time.process_time()
    fit(task.simulator, windows, nominal)
    ours = time.process_time() - began
    problem = own_problem(task)
    free = FreeStarts(problem)
    return (
        ours,
        _to_tolerance(free.parameters, free.residual),
        _to_tolerance(problem.parameters, documented(task)),
        _to_tolerance(problem.parameters, problem.residual),
    )


def own_problem(task: Task) -> Problem:
    """The problem's own parameters, from the nominal ones."""
    nominal = task.simulator.parameters.clamp(task.simulator.nominal).tolist()
    freed = [
        Freed(address, bounds.low, bounds.high, value, value, frozenset(), setter(address))
        for (address, bounds), value in zip(task.simulator.parameters.items(), nominal, strict=True)
    ]
    return Problem.of(task, freed)


def documented(task: Task) -> Any:
    """The residual as sysid's documentation builds it."""
    return sysid.build_residual_fn(models_sequences=[sequences(task)], modify_residual=_in_noise(task), n_threads=1)


def sequences(task: Task) -> sysid.ModelSequences:
    """Every fit window as a measured sequence of sysid's, one sensor a signal; nan where nothing was observed."""
    spec, windows = task.simulator.spec.copy(), task.fit_windows
    for signal in task.signals:
        sensor = spec.add_sensor()
        sensor.name, sensor.objname = signal, signal.partition(".")[2]
        sensor.type = (
            mujoco.mjtSensor.mjSENS_JOINTPOS if signal.startswith("qpos") else mujoco.mjtSensor.mjSENS_JOINTVEL
        )
        sensor.objtype = mujoco.mjtObj.mjOBJ_JOINT
    model, J = spec.compile(), windows.start.shape[1] // 2
    # Its resampling rounds the number of steps up: a hair too long a table would get one step more.
    times = np.arange(windows.rows + 1) * windows.step * (1 - 1e-9)
    value = np.where(windows.measured.numpy(), windows.value.numpy(), np.nan)
    value = np.concatenate([value[:, :1], value], 1)  # the first row is the start's, and is not compared
    command = windows.command.numpy()
    command = np.concatenate([command, command[:, -1:]], 1)
    return sysid.ModelSequences(
        task.name,
        spec,
        [str(w) for w in range(windows.count)],
        [sysid.create_initial_state(model, row[:J], row[J:]) for row in windows.start.numpy()],
        [sysid.TimeSeries(times, rows) for rows in command],
        [sysid.TimeSeries.from_names(times, rows, model) for rows in value],
    )


def _in_noise(task: Task) -> Any:
    """sysid's hook for residuals of one's own: simulated - measured at the measured rows, in sensor noise."""
    columns = list(task.fit_windows.columns)

    def weighed(
        params: sysid.ParameterDict,
        predicted: sysid.TimeSeries,
        measured: sysid.TimeSeries,
        model: mujoco.MjModel,
        return_pred_all: bool,
        state: np.ndarray,
    ) -> tuple[np.ndarray, sysid.TimeSeries, sysid.TimeSeries]:
        del params, predicted, model, return_pred_all
        # Sensors come a timestep late out of a rollout: they are read at the beginning of the step.
        path = sysid.TimeSeries(state[:, 0], state[:, 1:][:, columns], measured.signal_mapping)
        kept = sysid.TimeSeries(measured.times[1:], measured.data[1:], measured.signal_mapping)
        shown = path.resample(kept.times)
        return np.nan_to_num((shown.data - kept.data) / task.noise.numpy()), shown, kept

    return weighed


def _to_tolerance(parameters: sysid.ParameterDict, residual: Any) -> float:
    """Processor time until sysid's objective is within the tolerance of its last [s]."""
    marks: list[tuple[float, float]] = []
    began = time.process_time()
    sysid.optimize(
        parameters,
        residual,
        optimizer="mujoco",
        x_scale="jac",
        output=io.StringIO(),
        iter_callback=lambda log: marks.append((time.process_time() - began, float(log[-1].objective))),
    )
    # An entry is written after the step that leaves its point: that point was reached when the entry before was.
    near = next(k for k, (_, objective) in enumerate(marks) if objective <= marks[-1][1] * math.exp(2 * SETTLED))
    return marks[max(near - 1, 0)][0]
