"""The error of every signal before and after in one picture: how many times the noise floor, window by window.

    one row a signal, x = error / floor on a logarithmic axis; a dot for the RMS over all held-out windows, a bar from
    the 10 to the 90 % point of the windows, a tick for each window; the noise floor is the shaded part up to 1

In units of the floor signals of different units stand on one axis, and "1" means: as good as can be seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from onlinebayes.criticism import Criticism
from onlinebayes.identification import quantities

WIDTH, LEFT, RIGHT, ROW, BOTTOM = 540, 8, 532, 58, 46
MOST_TICKS = 200
"""Windows drawn one by one; more would hide each other."""


@dataclass(frozen=True)
class Row:
    """One signal: RMS and windows in multiples of its floor, and the RMS in words.

    Args:
        signal: its name.
        values: kind (``before``, ``after``) -> RMS over floor.
        windows: kind -> that of each held-out window.
        words: what stands beside it, e.g. ``6.6 mm → 2.0 mm``.
    """

    signal: str
    values: dict[str, float]
    windows: dict[str, list[float]]
    words: str


def spread_rows(result: Criticism) -> list[Row]:
    """The signals whose floor is known, the worst first."""
    errors, rows = result.heldout_error, []
    kinds = {"before": errors.before, "after": errors.after} if result.changed else {"before": errors.before}
    for signal in errors.before:
        floor = errors.noise_floor[signal]
        if not (floor > 0 and math.isfinite(floor) and all(math.isfinite(by[signal]) for by in kinds.values())):
            continue
        mine = [w for w in result.detail.windows if w.signal == signal and w.held_out]
        windows = {kind: [getattr(w, kind) / floor for w in mine if math.isfinite(getattr(w, kind))] for kind in kinds}
        words = " → ".join(quantities.texts([by[signal] for by in kinds.values()], result.units[signal]))
        rows.append(Row(signal, {kind: by[signal] / floor for kind, by in kinds.items()}, windows, words))
    return sorted(rows, key=lambda row: -row.values["before"])


def draw(rows: Sequence[Row], title: str) -> str:
    """The rows as one ``<svg>``; empty without any."""
    if not rows:
        return ""
    largest = max(max(*row.values.values(), 0.0, *(w for kind in row.windows.values() for w in kind)) for row in rows)
    low, high = math.log10(0.4), math.log10(max(2.0 * largest, 20.0))
    height = ROW * len(rows) + BOTTOM + 6

    def px(ratio: float) -> float:
        share = (math.log10(max(ratio, 1e-9)) - low) / (high - low)
        return LEFT + min(max(share, 0.0), 1.0) * (RIGHT - LEFT)

    parts = [_axis(px, high, ROW * len(rows) + 6)]
    for k, row in enumerate(rows):
        parts.append(_row(row, px, 6 + ROW * k))
    head = (
        f'<svg class="chart spread" viewBox="0 0 {WIDTH} {height}" role="img" aria-label="{escape(title, quote=True)}">'
    )
    return f"{head}{''.join(parts)}</svg>"


def _axis(px: Callable[[float], float], high: float, bottom: float) -> str:
    parts = [
        f'<rect class="floor" x="{LEFT}" y="4" width="{px(1.0) - LEFT:.1f}" height="{bottom - 4}">'
        "<title>within the noise</title></rect>"
    ]
    for power in range(math.floor(high) + 1):
        x = px(10.0**power)
        parts.append(f'<path class="grid" d="M{x:.1f} 4V{bottom}"/>')
        parts.append(f'<text class="tick" x="{x:.1f}" y="{bottom + 16}" text-anchor="middle">{10**power:,}</text>')
    middle = (LEFT + RIGHT) / 2
    parts.append(
        f'<text class="label" x="{middle:.0f}" y="{bottom + 36}" text-anchor="middle">'
        "error, in multiples of the noise floor</text>"
    )
    return "".join(parts)


def _row(row: Row, px: Callable[[float], float], top: float) -> str:
    name = row.signal if len(row.signal) <= 36 else f"{row.signal[:35]}…"
    parts = [
        f'<text class="name" x="{LEFT}" y="{top + 14}">{escape(name)}<title>{escape(row.signal)}</title></text>',
        f'<text class="value" x="{RIGHT}" y="{top + 14}" text-anchor="end">{escape(row.words)}</text>',
    ]
    for k, (kind, value) in enumerate(row.values.items()):
        y = top + (29 if k == 0 else 45) if len(row.values) > 1 else top + 36
        windows = row.windows[kind]
        if windows:
            low, high = (float(np.quantile(windows, q)) for q in (0.1, 0.9))
            parts.append(f'<path class="span {kind}" d="M{px(low):.1f} {y}H{px(high):.1f}"/>')
            d = "".join(f"M{px(w):.1f} {y - 5}v10" for w in windows[:MOST_TICKS])
            parts.append(f'<path class="mark {kind}" d="{d}"/>')
        text = f"{kind}: {quantities.times(value)} the noise floor"
        parts.append(f'<circle class="dot {kind}" cx="{px(value):.1f}" cy="{y}" r="6"><title>{text}</title></circle>')
    return "".join(parts)
