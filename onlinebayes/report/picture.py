"""The report's picture as a PNG, for papers, slides and READMEs: measured against simulated in the worst window."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from onlinebayes.criticism import Criticism
from onlinebayes.identification import quantities
from onlinebayes.report import replays, words
from onlinebayes.report.replays import Trace
from onlinebayes.runs import atomic_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STYLES: dict[str, dict[str, Any]] = {
    "measured": {"color": "#8b9096", "linewidth": 4.0, "label": "measured"},
    "before": {"color": "#d1571b", "linewidth": 1.8, "label": "model before"},
    "after": {"color": "#1769aa", "linewidth": 1.8, "label": "model after"},
}


def write_picture(result: Criticism, path: str | Path) -> None:
    """Write the PNG, atomically.

    Args:
        result: what ``compare``, ``diagnose`` or ``refine`` returned.
        path: file to write.

    Raises:
        ValueError: the result holds no replayed run.
        BadInput: the folder cannot be written.
    """
    from matplotlib.figure import Figure  # the object, not pyplot: no windows, no global state

    signal = words.worst_signal(result)
    worst = replays.worst_window(replays.traces(result, signal))
    if worst is None:
        raise ValueError("the result holds no replayed run to draw")
    figure = Figure(figsize=(9.0, 4.9), dpi=150, layout="constrained", facecolor="white")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    kinds = ("before", "after") if result.changed else ("before",)
    _signals(upper, worst, kinds, signal, result.units[signal])
    _errors(lower, worst, kinds, result.heldout_error.noise_floor[signal], result.units[signal])
    figure.suptitle(f"{words.headline(result)}\n{words.improvement(result)}", fontsize=11, x=0.01, ha="left")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")


def _signals(axes: Axes, worst: Trace, kinds: tuple[str, ...], signal: str, unit: str) -> None:
    scale = quantities.scale_for(float(np.nanmax(np.abs(worst.measured))), unit)
    for kind in ("measured", *kinds):
        axes.plot(worst.time, getattr(worst, kind) / scale.size, **STYLES[kind])
    _label(axes, f"{signal} [{scale.unit}]")
    axes.legend(loc="best", frameon=False, fontsize=9)


def _errors(axes: Axes, worst: Trace, kinds: tuple[str, ...], floor: float, unit: str) -> None:
    scale = quantities.scale_for(float(np.nanmax(np.abs(worst.before - worst.measured))), unit)
    axes.axhspan(-floor / scale.size, floor / scale.size, color="#9aa5b1", alpha=0.4, linewidth=0)
    for kind in kinds:
        axes.plot(worst.time, (getattr(worst, kind) - worst.measured) / scale.size, **STYLES[kind])
    _label(axes, f"error [{scale.unit}]")
    axes.set_xlabel("time [s]")


def _label(axes: Axes, text: str) -> None:
    axes.set_ylabel(text)
    axes.grid(color="#dfe3e8", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0)
