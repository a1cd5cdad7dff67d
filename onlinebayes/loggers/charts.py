"""Curves as small charts, drawn by matplotlib: as SVG for a page, as pixels for a recording."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#2a6f97", "#e07a2f", "#4c956c", "#7a5195", "#8a8f98", "#c9a227")
TRUTH = "#d1495b"
SIZE = (4.6, 2.9)  # inches


@dataclass(frozen=True)
class Curves:
    """A chart: some lines over one x.

    Args:
        title: above it.
        x: name and values.
        lines: name -> values; what is nan is left out.
        bands: name of a line -> low and high around it.
        levels: name -> height of a dashed line.
        diagonal: name of the dashed line y = x, if there is one.
    """

    title: str
    x: tuple[str, Sequence[float]]
    lines: Mapping[str, Sequence[float]]
    bands: Mapping[str, tuple[Sequence[float], Sequence[float]]] = field(default_factory=dict)
    levels: Mapping[str, float] = field(default_factory=dict)
    diagonal: str = ""


def calibration(levels: Sequence[float], coverage: Sequence[float]) -> Curves:
    """Nominal levels in [0, 1] and the share of truths that their regions hold; on the diagonal they agree."""
    return Curves("calibration", ("nominal level", levels), {"held-out truths inside": coverage}, diagonal="calibrated")


def to_svg(curves: Curves) -> str:
    """The chart as an SVG element."""
    from matplotlib import rc_context

    text = io.StringIO()
    with rc_context({"svg.fonttype": "none", "font.family": "sans-serif"}):  # letters, not outlines of letters
        _drawn(curves).savefig(text, format="svg")
    return text.getvalue()[text.getvalue().index("<svg") :]


def to_pixels(curves: Curves, *, dpi: int = 150) -> UInt8[np.ndarray, "H W 3"]:
    """The chart as a picture."""
    data = io.BytesIO()
    figure = _drawn(curves)
    figure.set_dpi(dpi)
    width, height = (round(float(inches * dpi)) for inches in figure.get_size_inches())
    figure.savefig(data, format="rgba", dpi=dpi)
    return np.frombuffer(data.getvalue(), np.uint8).reshape(height, width, 4)[..., :3].copy()


def _drawn(curves: Curves) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import EngFormatter, MaxNLocator

    figure = Figure(figsize=SIZE)
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.15, 0.17, 0.82, 0.65))  # fixed: a computed layout draws the chart thrice
    name, x = curves.x
    marker = "o" if len(x) <= 30 else ""
    for i, (line, values) in enumerate(curves.lines.items()):
        colour = COLOURS[i % len(COLOURS)]
        axes.plot(x, values, color=colour, marker=marker, markersize=3, linewidth=1.6, label=line)
        if line in curves.bands:
            axes.fill_between(x, *curves.bands[line], color=colour, alpha=0.2, linewidth=0)
    for level, height in curves.levels.items():
        axes.axhline(height, color=TRUTH, linestyle="--", linewidth=1.2, label=level)
    if curves.diagonal:
        axes.plot([0, 1], [0, 1], color=COLOURS[4], linestyle="--", linewidth=1, label=curves.diagonal)
    named = len(curves.lines) + len(curves.levels) + bool(curves.diagonal) > 1
    axes.set_title(curves.title, fontsize=11, loc="left", pad=20 if named else 6)
    axes.set_xlabel(name, fontsize=9)
    axes.tick_params(labelsize=8, color="#b8bdc5")
    whole = all(float(value).is_integer() for value in x)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=whole))
    if whole and max(x, default=0) >= 10_000:
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.grid(axis="y", color="#eceef1", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#b8bdc5")
    if named:  # above the curves: within it would hide some
        axes.legend(fontsize=8, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(-0.03, 0.97), borderaxespad=0)
    return figure
