"""The recording's layout: the text on the left, a tab for each run on the right, the worst held-out run in front."""

from __future__ import annotations

from typing import TYPE_CHECKING

from onlinebayes.criticism.report import quantities, replays, words
from onlinebayes.criticism.results import Criticism

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


def blueprint(result: Criticism, runs: tuple[str, ...], *, scene: bool) -> Blueprint:
    """The layout; ``scene`` adds a view of the geometry."""
    import rerun.blueprint as rrb

    held_out = set(result.held_out_runs)
    tabs = [_run(result, run, f"{run} (held out)" if run in held_out else run, scene) for run in runs]
    text = rrb.Vertical(
        rrb.TextDocumentView(origin="report", name="Report"),
        rrb.TextDocumentView(origin="ranking", name="Ranking"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(text, rrb.Tabs(*tabs) if tabs else text, column_shares=[2, 3]),
        rrb.TimePanel(timeline="time", state="collapsed"),
        collapse_panels=True,
    )


def _run(result: Criticism, run: str, name: str, scene: bool) -> Vertical:
    import rerun as rr
    import rerun.blueprint as rrb

    root = f"runs/{rr.escape_entity_path_part(run)}"
    worst = words.worst_signal(result)
    signals = sorted(result.signals, key=lambda signal: signal != worst)[:SIGNALS_SHOWN]
    views: list[rrb.View] = []
    if scene:
        views.append(rrb.Spatial3DView(origin=f"{root}/scene", name="measured solid, models as wireframes"))
    for signal in signals:
        part, unit = rr.escape_entity_path_part(signal), result.units[signal]
        small = error_scale(result, signal).unit
        views.append(rrb.TimeSeriesView(origin=f"{root}/signals/{part}", name=f"{signal} [{unit}]"))
        views.append(rrb.TimeSeriesView(origin=f"{root}/errors/{part}", name=f"error of {signal} [{small}]"))
    if result.commands:
        views.append(rrb.TimeSeriesView(origin=f"{root}/commands", name="commands"))
    return rrb.Vertical(*views, name=name)
