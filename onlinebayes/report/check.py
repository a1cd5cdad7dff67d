"""A check as files: check.json for programs, check.png with what changed run by run."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from onlinebayes.criticism import FALSE_ALARMS, Check, Drift
from onlinebayes.identification import quantities
from onlinebayes.inference import plots
from onlinebayes.report import check_words
from onlinebayes.runs import together, write_atomic
from onlinebayes.runs.results import versions

SCHEMA = 1
FILES = ("check.png", "check.json")

REFERENCE, NEW = "#8a8f98", "#d1495b"
MOST_NAMED = 12
"""Runs at most whose names stand below a plot."""

WIDE = 1.645
"""Sd of half a 90 % interval."""


@together()
def write_check(found: Check, out_dir: str | Path) -> tuple[str, ...]:
    """Write both files, each atomically; check.json last, because programs wait for it.

    Raises:
        BadInput: the folder cannot be made or written.
    """
    folder = Path(out_dir)
    plots.save(figure(found), folder / "check.png")
    text = json.dumps(to_dict(found), indent=1, ensure_ascii=False, allow_nan=False)
    write_atomic(folder / "check.json", text + "\n")
    return FILES


def to_dict(found: Check) -> dict[str, Any]:
    """The content of check.json."""
    return {
        "schema": SCHEMA,
        "versions": versions(),
        **asdict(found),
        "false_alarm_rate": FALSE_ALARMS,
        "in_words": [f"{label}: {text}" for label, text in check_words.lines(found)],
    }


def figure(found: Check) -> Figure:
    """One panel for each drift: the value in every run with its 90 % interval, reference runs grey."""
    count = max(len(found.drifts), 1)
    drawn = Figure(figsize=(7.0, 0.6 + 1.9 * count), layout="constrained")
    FigureCanvasAgg(drawn)
    for k, drift in enumerate(found.drifts):
        _panel(drawn.add_subplot(count, 1, k + 1), drift, last=k == count - 1)
    return drawn


def _panel(axes: Axes, drift: Drift, *, last: bool) -> None:
    scale = quantities.shared_scale([point.value for point in drift.points], drift.unit)
    for colour, old, label in ((REFERENCE, True, "reference"), (NEW, False, "new")):
        mine = [(k, point) for k, point in enumerate(drift.points) if point.reference == old]
        if mine:
            values = [point.value / scale.size for _, point in mine]
            bars = [WIDE * point.sd / scale.size for _, point in mine]
            axes.errorbar([k for k, _ in mine], values, bars, fmt="o", color=colour, label=label, markersize=4)
    axes.set_ylabel(f"{drift.key}\n[{scale.unit}]" if scale.unit else drift.key, fontsize=8)
    axes.tick_params(labelsize=7)
    named = range(0, len(drift.points), -(-len(drift.points) // MOST_NAMED)) if last else []
    axes.set_xticks(list(named), [drift.points[k].run for k in named], rotation=30, ha="right")
    axes.legend(fontsize=7, loc="best")
