"""run.rrd: the runs as a Rerun recording with a layout of its own; open it with ``rerun run.rrd``.

| entity                                      | content                                                        |
|---------------------------------------------|----------------------------------------------------------------|
| ``report``, ``ranking``                     | Markdown: the headline and its figures; the candidate effects  |
| ``runs/RUN/signals/SIGNAL/measured|before|after`` | the signal as measured, by the base and by the final model |
| ``runs/RUN/errors/SIGNAL/before|after``     | simulated minus measured, in the unit that the layout names     |
| ``runs/RUN/commands/COMMAND``               | what was commanded                                             |
| ``runs/RUN/forces/EFFECT``                  | force of an added effect at its joint, where it is one [N, N m] |
| ``runs/RUN/scene/measured|before|after``    | the model's geometry, for MuJoCo models                        |
| ``runs/RUN/scene/forces/EFFECT``            | the same forces as arrows                                      |

Time line: ``time``, seconds of the run. Curves are thinned to at most ``RATE`` rows a second: report.json holds the
figures, the recording is for looking.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy.typing import NDArray

from onlinebayes.criticism import Criticism
from onlinebayes.identification import EffectForce, ReplayedRun, effect_forces, unwrap
from onlinebayes.report import arrows, documents, geometry, layout
from onlinebayes.report.colours import COLOURS, EFFECTS
from onlinebayes.report.geometry import Colour
from onlinebayes.runs import atomic_path
from onlinebayes.simulators.mujoco import MujocoSimulator

if TYPE_CHECKING:
    from rerun import RecordingStream

RATE = 200.0
"""Largest number of rows a second of the curves [1/s]."""
SCENE_RATE = 50.0
"""Largest number of poses a second of the geometry [1/s]."""
MOST_ROWS = 40_000


def write_recording(result: Criticism, path: str | Path) -> None:
    """Write the recording, atomically."""
    import rerun as rr

    with atomic_path(path) as temporary:
        stream = rr.RecordingStream("onlinebayes", send_properties=False)
        held = stream.memory_recording()  # Rerun's own writer waits for ever where the disk is full
        runs = layout.shown_runs(result)
        simulator = unwrap(result.final.simulator)
        model = simulator.model if isinstance(simulator, MujocoSimulator) else None
        stream.send_blueprint(layout.blueprint(result, runs, model))
        for name, text in (("report", documents.report(result)), ("ranking", documents.ranking(result))):
            stream.log(name, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)
        for before, after in zip(result.base.replays, result.final.replays, strict=True):
            forces = effect_forces(result.final, after, result.signals)
            _send_curves(stream, result, before, after)
            _send_forces(stream, after, forces)
            if model is not None and before.run in runs:
                _send_scene(stream, result, model, before, after, forces)
        temporary.write_bytes(held.drain_as_bytes())


def rows(time: NDArray[np.float64], rate: float) -> NDArray[np.intp]:
    """Indices of every n-th row, so that at most ``rate`` rows a second and MOST_ROWS in all are kept."""
    if len(time) < 2 or time[-1] <= time[0]:
        return np.arange(len(time))
    given = (len(time) - 1) / (time[-1] - time[0])
    step = max(1, int(np.ceil(given / rate * (1 - 1e-6))), int(np.ceil(len(time) / MOST_ROWS)))
    return np.arange(0, len(time), step)


def variants(result: Criticism) -> tuple[str, ...]:
    """The models to draw: before and after, or the one there is."""
    return ("before", "after") if result.changed else ("before",)


def _send_curves(stream: RecordingStream, result: Criticism, before: ReplayedRun, after: ReplayedRun) -> None:
    time = before.time.cpu().numpy()
    keep = rows(time, RATE)
    measured = before.measured.cpu().numpy()[keep]
    simulated = {"before": before.simulated.cpu().numpy()[keep], "after": after.simulated.cpu().numpy()[keep]}
    run = before.run
    for s, signal in enumerate(result.signals):
        _curve(stream, (run, "signals", signal, "measured"), time[keep], measured[:, s], "measured")
        for kind in variants(result):
            values = simulated[kind][:, s]
            error = (values - measured[:, s]) / layout.error_scale(result, signal).size
            _curve(stream, (run, "signals", signal, kind), time[keep], values, kind)
            _curve(stream, (run, "errors", signal, kind), time[keep], error, kind)
    for u, command in enumerate(result.commands):
        _curve(stream, (run, "commands", command), time[keep], before.command.cpu().numpy()[keep, u], "command")


def _send_forces(stream: RecordingStream, run: ReplayedRun, forces: tuple[EffectForce, ...]) -> None:
    time = run.time.cpu().numpy()
    keep = rows(time, RATE)
    for k, force in enumerate(forces):
        values = force.value.cpu().numpy()[keep]
        _curve(stream, (run.run, "forces", force.effect), time[keep], values, "force", EFFECTS[k % len(EFFECTS)])


def _curve(
    stream: RecordingStream,
    parts: tuple[str, ...],
    time: NDArray[np.float64],
    values: NDArray[np.float64],
    kind: str,
    colour: Colour | None = None,
) -> None:
    import rerun as rr

    known = np.isfinite(values)
    if not known.any():
        return
    path = geometry.entity("runs", *parts)
    stream.log(
        path, rr.SeriesLines(colors=[colour or COLOURS[kind]], names=[parts[-1]], widths=[_WIDTHS[kind]]), static=True
    )
    stream.send_columns(path, [rr.TimeColumn("time", duration=time[known])], rr.Scalars.columns(scalars=values[known]))


def _send_scene(
    stream: RecordingStream,
    result: Criticism,
    model: mujoco.MjModel,
    before: ReplayedRun,
    after: ReplayedRun,
    forces: tuple[EffectForce, ...],
) -> None:
    time = before.time.cpu().numpy()
    keep = rows(time, SCENE_RATE)
    simulated = {"before": before.qpos.cpu().numpy()[keep], "after": after.qpos.cpu().numpy()[keep]}
    measured = before.measured.cpu().numpy()[keep]
    root = geometry.entity("runs", before.run, "scene")
    real = geometry.measured_qpos(model, result.signals, measured, simulated["after"])
    away = measured - after.simulated.cpu().numpy()[keep]
    real = geometry.measured_turns(model, result.signals, away, real)
    geometry.log_shapes(stream, f"{root}/measured", model)
    geometry.send_motion(stream, f"{root}/measured", model, time[keep], real)
    arrows.send_arrows(stream, f"{root}/forces", model, time[keep], simulated["after"], forces, keep)
    for kind in variants(result):
        geometry.log_shapes(stream, f"{root}/{kind}", model, ghost=COLOURS[kind])
        geometry.send_motion(stream, f"{root}/{kind}", model, time[keep], simulated[kind])


_WIDTHS = {"measured": 3.0, "before": 1.5, "after": 1.5, "command": 1.5, "force": 1.5}
