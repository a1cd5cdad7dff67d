"""Line charts as inline SVG: no library, no script, colours from the page's style sheet.

A chart is panels above each other on one x axis. Curves carry a CSS class (``measured``, ``before``, ``after``), so the
page decides the colours, in daylight and in the dark. A long curve is drawn by its smallest and largest value in each
pixel column, so that a spike is never lost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
LEFT, RIGHT, TOP, GAP, BOTTOM = 66, 16, 8, 16, 34


@dataclass(frozen=True)
class Curve:
    """One line: ``y`` over ``x``; nan breaks it; ``kind`` is its CSS class, ``label`` its tooltip.

    With ``dots`` its points, in any order, are drawn one by one and not joined.
    """

    x: Array
    y: Array
    kind: str
    label: str
    dots: bool = False


@dataclass(frozen=True)
class Panel:
    """One set of axes.

    Args:
        curves: drawn in order, the last on top.
        y_label: quantity and unit.
        height: of the plotting area [px].
        band: half-width of a band around zero (the noise floor) [unit of y], or None.
    """

    curves: Sequence[Curve]
    y_label: str
    height: int
    band: float | None = None


def chart(panels: Sequence[Panel], x_label: str, *, width: int = 880, title: str = "") -> str:
    """Panels above each other with a shared x axis, as one ``<svg>`` element that scales with the page."""
    xs = [c.x[np.isfinite(c.x)] for panel in panels for c in panel.curves if np.isfinite(c.x).any()]
    x_range = (min(float(x.min()) for x in xs), max(float(x.max()) for x in xs)) if xs else (0.0, 1.0)
    if x_range[0] == x_range[1]:
        x_range = (x_range[0] - 0.5, x_range[1] + 0.5)
    height = TOP + sum(panel.height for panel in panels) + GAP * (len(panels) - 1) + BOTTOM
    parts, top = [], float(TOP)
    for k, panel in enumerate(panels):
        frame = _Frame(x_range, _y_range(panel), LEFT, width - RIGHT, top, top + panel.height)
        parts.append(_panel(panel, frame, x_label if k == len(panels) - 1 else None))
        top += panel.height + GAP
    label = escape(title, quote=True)
    kind = "chart wide" if width > 600 else "chart"
    return f'<svg class="{kind}" viewBox="0 0 {width} {height}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def nice_ticks(low: float, high: float, count: int = 5) -> list[float]:
    """About ``count`` round numbers (1, 2 or 5 times a power of ten apart) within [low, high]."""
    if not (math.isfinite(low) and math.isfinite(high)) or high <= low:
        return []
    raw = (high - low) / count
    power = 10.0 ** math.floor(math.log10(raw))
    for step in sorted((m * power for m in (0.5, 1, 2, 5, 10)), key=lambda s: abs(math.log(s / raw))):
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first >= min(count, 3) - 1:
            break
    return [k * step for k in range(first, last + 1)]


def largest(values: Array) -> float:
    """Largest absolute finite value, 0 where there is none."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max()) if len(finite) else 0.0


def decimate(x: Array, y: Array, columns: int) -> tuple[Array, Array]:
    """The points that decide the drawing: per column of equal x width the smallest and the largest y, in order of x.

    A column without a finite value gives one nan, which breaks the line there as the data is broken.
    """
    if len(x) <= 2 * columns:
        return x, y
    edges = np.unique(np.searchsorted(x, np.linspace(x[0], x[-1], columns + 1)[:-1]))
    broken = np.isnan(y)
    low = edges + _arg(np.minimum, np.where(broken, np.inf, y), edges)
    high = edges + _arg(np.maximum, np.where(broken, -np.inf, y), edges)
    keep = np.unique(np.concatenate([[0], low, high, [len(x) - 1]]))
    return x[keep], y[keep]


def _arg(ufunc: np.ufunc, y: Array, edges: NDArray[np.intp]) -> NDArray[np.intp]:
    """Offset of the extreme within each segment that starts at ``edges``."""
    extreme = ufunc.reduceat(y, edges)
    lengths = np.diff(np.append(edges, len(y)))
    hit = np.flatnonzero(y == np.repeat(extreme, lengths))
    owner = np.searchsorted(edges, hit, side="right") - 1
    _, first = np.unique(owner, return_index=True)
    return hit[first] - edges


@dataclass(frozen=True)
class _Frame:
    """Data ranges and where they lie on the page [px]."""

    x: tuple[float, float]
    y: tuple[float, float]
    left: float
    right: float
    top: float
    bottom: float

    def px(self, x: Array | float) -> Array | float:
        return self.left + (x - self.x[0]) / (self.x[1] - self.x[0]) * (self.right - self.left)

    def py(self, y: Array | float) -> Array | float:
        return self.bottom - (y - self.y[0]) / (self.y[1] - self.y[0]) * (self.bottom - self.top)


def _y_range(panel: Panel) -> tuple[float, float]:
    ys = [c.y[np.isfinite(c.y)] for c in panel.curves if np.isfinite(c.y).any()]
    low, high = (min(float(y.min()) for y in ys), max(float(y.max()) for y in ys)) if ys else (-1.0, 1.0)
    if panel.band is not None:
        low, high = min(low, -panel.band), max(high, panel.band)
    margin = 0.06 * (high - low) or max(abs(high), 1.0) * 0.1
    return low - margin, high + margin


def _panel(panel: Panel, frame: _Frame, x_label: str | None) -> str:
    parts = [_grid(frame, x_label, panel.height)]
    if panel.band is not None:
        top, bottom = frame.py(panel.band), frame.py(-panel.band)
        parts.append(
            f'<rect class="floor" x="{frame.left:.1f}" width="{frame.right - frame.left:.1f}" y="{top:.1f}" '
            f'height="{max(float(bottom - top), 1.0):.1f}"><title>noise floor</title></rect>'
        )
    columns = int(frame.right - frame.left)
    for curve in panel.curves:
        x, y = (curve.x, curve.y) if curve.dots else decimate(curve.x, curve.y, columns)
        d = (_dots if curve.dots else _path)(np.asarray(frame.px(x)), np.asarray(frame.py(y)))
        kind = f"dots {curve.kind}" if curve.dots else f"curve {curve.kind}"
        parts.append(f'<path class="{kind}" d="{d}"><title>{escape(curve.label)}</title></path>')
    middle = (frame.top + frame.bottom) / 2
    parts.append(
        f'<text class="label" transform="translate(14 {middle:.0f}) rotate(-90)" text-anchor="middle">'
        f"{escape(panel.y_label)}</text>"
    )
    return "".join(parts)


def _grid(frame: _Frame, x_label: str | None, height: int) -> str:
    parts = []
    y_ticks = nice_ticks(*frame.y, count=max(3, height // 42))
    for value, text in zip(y_ticks, _tick_texts(y_ticks), strict=True):
        y = frame.py(value)
        kind = "zero" if value == 0 else "grid"
        parts.append(f'<path class="{kind}" d="M{frame.left} {y:.1f}H{frame.right}"/>')
        parts.append(f'<text class="tick" x="{frame.left - 6}" y="{y + 4:.1f}" text-anchor="end">{text}</text>')
    x_ticks = nice_ticks(*frame.x, count=max(2, int(frame.right - frame.left) // 95))
    for value, text in zip(x_ticks, _tick_texts(x_ticks), strict=True):
        x = frame.px(value)
        parts.append(f'<path class="grid" d="M{x:.1f} {frame.top}V{frame.bottom}"/>')
        if x_label is not None:
            parts.append(f'<text class="tick" x="{x:.1f}" y="{frame.bottom + 15}" text-anchor="middle">{text}</text>')
    if x_label is not None:
        parts.append(
            f'<text class="label" x="{(frame.left + frame.right) / 2:.0f}" y="{frame.bottom + 31}" '
            f'text-anchor="middle">{escape(x_label)}</text>'
        )
    return "".join(parts)


def _tick_texts(ticks: Sequence[float]) -> list[str]:
    if len(ticks) < 2:
        return [f"{tick:g}" for tick in ticks]
    step = ticks[1] - ticks[0]
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    if digits > 4 or max(map(abs, ticks)) >= 1e6:
        return [f"{tick:.3g}" for tick in ticks]
    return [f"{tick + 0.0:.{digits}f}".replace("-", "−") for tick in ticks]


def _path(x: Array, y: Array) -> str:
    """SVG path through the finite points, lifted over the others; coordinates to a tenth of a pixel."""
    parts, pen = [], False
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if not (math.isfinite(a) and math.isfinite(b)):
            pen = False
            continue
        parts.append(f"{'L' if pen else 'M'}{a:.1f} {b:.1f}")
        pen = True
    return "".join(parts)


def _dots(x: Array, y: Array) -> str:
    """SVG path of a line without length at each finite point, which a round cap makes a dot."""
    known = np.isfinite(x) & np.isfinite(y)
    return "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[known].tolist(), y[known].tolist(), strict=True))
