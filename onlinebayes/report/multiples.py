"""A profile as a small picture: in each bin the share of time (wide, grey), of error before and of error after.

Where the coloured bar is taller than the grey one the model fails more often than it is there.
"""

from __future__ import annotations

from html import escape

import numpy as np

from onlinebayes.identification import Profile, quantities
from onlinebayes.report import svg

WIDTH, HEIGHT, LEFT, RIGHT, TOP, BOTTOM = 300, 158, 40, 8, 8, 34
TITLES = {
    "time": "by time in the run",
    "position": "by position",
    "velocity": "by velocity",
    "direction": "by direction of motion",
    "reversal": "by time since the last reversal",
    "command": "by command",
    "run": "by run",
}
EVEN = 0.1  # concentration below which the error counts as spread evenly
MOST_LABELS = 6  # categories that can be named below their bars; of more, the caption names the worst
LIFT = 1.25  # share of error over share of time from which a bin belongs to a region


def title(profile: Profile) -> str:
    """``by velocity of carriage``."""
    about = profile.name.partition(".")[2]
    of = f" of {about}" if profile.quantity in ("position", "velocity", "command") and about else ""
    return f"{TITLES[profile.quantity]}{of}"


def telling(profile: Profile) -> str:
    """Say where the error concentrates, in one phrase: ``44 % of the error in 12 % of the time: 0 to 0.1 m/s``."""
    excess = np.subtract(profile.before, profile.time)
    if profile.concentration < EVEN:
        return "no part of it stands out"
    first = last = int(excess.argmax())
    n = len(excess)
    if not profile.labels:  # neighbours that stand out as well belong to the same region
        while first > 0 and profile.before[first - 1] > LIFT * profile.time[first - 1] > 0:
            first -= 1
        while last < n - 1 and profile.before[last + 1] > LIFT * profile.time[last + 1] > 0:
            last += 1
    error, time = sum(profile.before[first : last + 1]), sum(profile.time[first : last + 1])
    share = f"{quantities.percent(error)} of the error in {quantities.percent(time)} of the time"
    return f"{share}: {_region(profile, first, last)}"


def draw(profile: Profile, changed: bool) -> str:
    """One ``<svg>`` of 300 by 158 px."""
    n = len(profile.time)
    highest = max(max(profile.time), max(profile.before), max(profile.after) if changed else 0.0)
    floor, width = HEIGHT - BOTTOM, (WIDTH - LEFT - RIGHT) / n

    def py(share: float) -> float:
        return floor - min(share / (1.05 * highest), 1.0) * (floor - TOP)

    parts = []
    for tick in svg.nice_ticks(0.0, highest, 3):
        parts.append(f'<path class="grid" d="M{LEFT} {py(tick):.1f}H{WIDTH - RIGHT}"/>')
        parts.append(
            f'<text class="tick" x="{LEFT - 5}" y="{py(tick) + 4:.1f}" text-anchor="end">{100 * tick:.3g} %</text>'
        )
    layers = [("time", profile.time, 0.94), ("before", profile.before, 0.62), ("after", profile.after, 0.30)]
    for kind, shares, part in layers if changed else layers[:2]:
        for b, share in enumerate(shares):
            if share > 0:
                x = LEFT + width * (b + 0.5 - part / 2)
                parts.append(
                    f'<rect class="share {kind}" x="{x:.1f}" y="{py(share):.1f}" width="{width * part:.1f}" '
                    f'height="{max(floor - py(share), 0.8):.1f}"/>'
                )
    parts += [f'<path class="zero" d="M{LEFT} {floor}H{WIDTH - RIGHT}"/>', *_labels(profile, width)]
    label = escape(f"Error of {profile.signal} {title(profile)}: {telling(profile)}", quote=True)
    return f'<svg class="chart" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">{"".join(parts)}</svg>'


def _labels(profile: Profile, width: float) -> list[str]:
    """Names of the categories as far as they fit, or edges at both ends and in the middle, with the unit."""
    y, n = HEIGHT - BOTTOM + 15, len(profile.time)
    if profile.labels:
        fits = max(3, int(width / 6.2))
        return [
            f'<text class="tick" x="{LEFT + width * (b + 0.5):.1f}" y="{y}" text-anchor="middle">'
            f"{escape(text if len(text) <= fits else text[: fits - 1] + '…')}<title>{escape(text)}</title></text>"
            for b, text in enumerate(profile.labels[: n if n <= MOST_LABELS else 0])
        ]
    scale = _scale(profile)
    parts = []
    for b, anchor in ((0, "start"), (n // 2, "middle"), (n, "end")):
        text = f"{_edge(profile, b)} {scale.unit}".strip() if b == n else _edge(profile, b)
        parts.append(
            f'<text class="tick" x="{LEFT + width * b:.1f}" y="{y}" text-anchor="{anchor}">{escape(text)}</text>'
        )
    return parts


def _region(profile: Profile, first: int, last: int) -> str:
    if profile.labels:
        return profile.labels[first]
    return f"{_edge(profile, first)} to {_edge(profile, last + 1)} {_scale(profile).unit}".strip()


def _scale(profile: Profile) -> quantities.Scale:
    return quantities.scale_for(max(abs(edge) for edge in profile.edges), profile.unit)


def _edge(profile: Profile, b: int) -> str:
    """The edge in the profile's unit; what is nothing beside the range is 0."""
    value, span = profile.edges[b], profile.edges[-1] - profile.edges[0]
    return quantities.significant(0.0 if abs(value) < 1e-3 * span else value / _scale(profile).size).replace("-", "−")
