"""The recording's layout: the text on the left, a tab for each run on the right, the worst held-out run in front."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from onlinebayes.criticism import Criticism
from onlinebayes.identification import effect_forces, quantities
from onlinebayes.report import arrows, geometry, replays, words

if TYPE_CHECKING:
    from rerun.blueprint import Blueprint, Vertical

RUNS_SHOWN = 6
SIGNALS_SHOWN = 3


def shown_runs(result: Criticism) -> tuple[str, ...]:
    """Runs that get a tab, the one with the worst window first, then the other held-out ones."""
    traces = replays.traces(result, words.worst_signal(result))
    worst = replays.worst_window(traces)
    names = [trace.run for trace in traces]
    first = [worst.run] if worst else []
    return tuple(dict.fromkeys([*first, *names]))[:RUNS_SHOWN]


def error_scale(result: Criticism, signal: str) -> quantities.Scale:
    """The unit in which the errors of a signal are drawn."""
    return quantities.scale_for(result.heldout_error.before[signal], result.units[signal])


def blueprint(result: Criticism, runs: tuple[str, ...], model: mujoco.MjModel | None) -> Blueprint:
    """The layout; with a ``model`` each run has a view of its geometry."""
    import rerun.blueprint as rrb

    held_out = set(result.held_out_runs)
    tabs = [_run(result, run, f"{run} (held out)" if run in held_out else run, model) for run in runs]
    text = rrb.Vertical(
        rrb.TextDocumentView(origin="report", name="Report"),
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(text, rrb.Tabs(*tabs) if tabs else text, column_shares=[2, 3]),
        rrb.TimePanel(timeline="time", state="collapsed"),
        collapse_panels=True,
    )


def _run(result: Criticism, run: str, name: str, model: mujoco.MjModel | None) -> Vertical:
    import rerun as rr
    import rerun.blueprint as rrb

    root = f"runs/{rr.escape_entity_path_part(run)}"
    worst = words.worst_signal(result)
    signals = sorted(result.signals, key=lambda signal: signal != worst)[:SIGNALS_SHOWN]
    views: list[rrb.View] = []
    after = next(replay for replay in result.final.replays if replay.run == run)
    forces = effect_forces(result.final, after, result.signals)
    if model is not None:
        moved = after.qpos.cpu().numpy()
        name_3d, eye = (
            "measured solid, models as wireframes, added effects as arrows",
            _eye(model, moved, 1.5 * arrows.LIFT * len(forces)),
        )
        views.append(rrb.Spatial3DView(origin=f"{root}/scene", name=name_3d, eye_controls=eye))
    for signal in signals:
        part, unit = rr.escape_entity_path_part(signal), result.units[signal]
        small, size = error_scale(result, signal).unit, error_scale(result, signal).size
        trace = next(trace for trace in replays.traces(result, signal) if trace.run == run)
        errors = [(trace.before - trace.measured) / size, (trace.after - trace.measured) / size]
        views += [
            rrb.TimeSeriesView(
                origin=f"{root}/signals/{part}",
                name=f"{signal} [{unit}]",
                axis_y=_axis(trace.measured, trace.before, trace.after),
            ),
            rrb.TimeSeriesView(
                origin=f"{root}/errors/{part}", name=f"error of {signal} [{small}]", axis_y=_axis(*errors)
            ),
        ]
    if forces:
        axis = _axis(*(force.value.cpu().numpy() for force in forces))
        views.append(rrb.TimeSeriesView(origin=f"{root}/forces", name="forces of the added effects", axis_y=axis))
    if result.commands:
        command = next(replay.command for replay in result.base.replays if replay.run == run).cpu().numpy()
        views.append(rrb.TimeSeriesView(origin=f"{root}/commands", name="commands", axis_y=_axis(command)))
    shares = [1.5 if isinstance(view, rrb.Spatial3DView) else 1.0 for view in views]
    return rrb.Vertical(*views, name=name, row_shares=shares)


def _axis(*values: np.ndarray) -> Any:
    """A y axis that holds all finite values; the viewer's own first guess is -1 to 1."""
    import rerun.blueprint as rrb

    known = np.concatenate([v[np.isfinite(v)].ravel() for v in values])
    if not len(known):
        return None
    low, high = float(known.min()), float(known.max())
    margin = 0.05 * (high - low) or 1e-6
    return rrb.ScalarAxis(range=(low - margin, high + margin))


def _eye(model: mujoco.MjModel, qpos: np.ndarray, above: float) -> Any:
    """A view from the front and above that holds everything that moves, all the time, in a wide and low window.

    Args:
        model: the compiled model.
        qpos: (T, nq) all its positions.
        above: height of what is drawn above it, as a share of its width.
    """
    import rerun.blueprint as rrb

    low, high = geometry.bounds(model, qpos[:: max(1, len(qpos) // 50)])
    high[2] += above * float((high - low).max())
    centre, (wide, deep, tall) = (low + high) / 2, high - low
    distance = 0.6 * deep + max(1.25 * tall, 0.5 * wide, 1e-3)
    return rrb.EyeControls3D(
        position=centre + distance * np.array([0.25, -0.9, 0.4]), look_target=centre, eye_up=(0.0, 0.0, 1.0)
    )
