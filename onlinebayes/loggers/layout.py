"""Layout of a run in the viewer: its views, their places, and the colour of each curve.

The episode and the belief above; below, each parameter's interval over time, and in tabs the returns beside baselines,
losses, fits and seconds. A policy that learns alone has no views of a belief. A group of curves has a view for each
entity, as their scales differ; returns share one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from onlinebayes.loggers.charts import COLOURS, TRUTH
from onlinebayes.parameters import ParameterSpace
from onlinebayes.simulators.drawing import View

GREY = COLOURS[4]
INTERVALS = {  # entity -> colour, width, name in the legend
    "belief/mean": (COLOURS[0], 2.5, "belief: mean"),
    "belief/low": (COLOURS[0], 1.0, "belief: 5 %"),
    "belief/high": (COLOURS[0], 1.0, "belief: 95 %"),
    "belief/truth": (TRUTH, 1.5, "truth"),
    "proposal/low": (GREY, 1.0, "proposal: 5 %"),
    "proposal/high": (GREY, 1.0, "proposal: 95 %"),
}
GROUPS = {
    "losses": "policy losses",
    "fit": "fit of the belief",
    "seconds": "seconds a step",
    "speed": "speed",
    "criticism": "criticism",
}
RETURNS = ("online", "oracle", "posterior-first", "prior")


def path(*parts: str) -> str:
    """Entity path of these parts, whatever stands in them."""
    from rerun import escape_entity_path_part

    return "/".join(escape_entity_path_part(part) for part in parts)


def style(name: str, index: int) -> Any:
    """The line of a scalar entity, ``index`` being how many of its group came before."""
    import rerun as rr

    parts = name.split("/")
    group, last = parts[0], parts[-1]
    colour, width, label = INTERVALS.get(f"{group}/{last}", (COLOURS[index % len(COLOURS)], 2.0, last))
    if group == "returns" and last in RETURNS:
        colour = COLOURS[(0, 2, 1, 4)[RETURNS.index(last)]]
    return rr.SeriesLines(colors=[_rgb(colour)], widths=[width], names=[label])


def blueprint(
    space: ParameterSpace,
    scalars: Sequence[str],
    pictures: Sequence[str],
    view: View | None,
    speed: float,
    *,
    events: bool = False,
) -> Any:
    """The layout.

    Args:
        space: the parameters.
        scalars: names of all curves.
        pictures: names of all pictures, in the order of their tabs but for the corner, which is first.
        view: what an episode needs; None before the first.
        speed: at which the run is played, again and again.
        events: whether there are log lines to show.
    """
    import rerun.blueprint as rrb

    intervals = [
        rrb.TimeSeriesView(
            name=f"{name} [{space[name].unit}]" if space[name].unit else name,
            contents=[f"{path('belief', name)}/**", f"{path('proposal', name)}/**"],
            plot_legend=rrb.PlotLegend(corner="RightTop", visible=len(space) <= 2),
            axis_x=_whole(),
        )
        for name in space.names
    ]
    marginals = [
        rrb.BarChartView(name=f"{name} [{space[name].unit}]", contents=f"{path('marginals', name)}/**")
        for name in space.names
    ]
    episode = rrb.Spatial3DView(
        name="real (solid), simulated with the same actions (orange wireframe)",
        contents="episodes/**",
        eye_controls=None if view is None else _eye(view),
        background=[28, 30, 34],
        line_grid=rrb.LineGrid3D(visible=False),
    )
    seen = [
        rrb.Spatial2DView(name=name, contents=path(name))
        for name in sorted(pictures, key=lambda name: name != "corner")
    ]
    time = rrb.TimePanel(
        state="collapsed", timeline="time", play_state="playing", loop_mode="all", playback_speed=speed
    )
    summary, curves = rrb.TextDocumentView(name="summary", contents="summary"), rrb.Tabs(*_curves(scalars))
    told = [summary, *[rrb.TextLogView(name="events", origin="events")] * events]
    above: list[Any]
    below: list[Any]
    if any(name.startswith("belief/") for name in scalars):
        above = [episode, rrb.Tabs(*seen, rrb.Grid(*marginals, name="marginals"), *told)]
        below = [_grid("belief", intervals), curves]
    else:
        above, below = [episode, rrb.Tabs(*seen, *told)], [curves]
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(*above), rrb.Horizontal(*below), row_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        time,
    )


def _rgb(colour: str) -> list[int]:
    """``#rrggbb`` as three numbers."""
    return [int(colour[i : i + 2], 16) for i in (1, 3, 5)]


def _curves(scalars: Sequence[str]) -> list[Any]:
    """One tab a group, one view a curve."""
    import rerun.blueprint as rrb

    groups: dict[str, list[str]] = {}
    for name in scalars:
        groups.setdefault(name.split("/")[0], []).append(name)
    tabs: list[Any] = []
    if "returns" in groups:
        tabs += [rrb.TimeSeriesView(name="return beside baselines", contents="returns/**", axis_x=_whole())]
    if figures := groups.get("figures"):
        tabs += [_grid("figures", [_view(name) for name in figures])]
    for group, title in GROUPS.items():
        if group in groups:
            tabs += [_grid(title, [_view(name) for name in groups[group]])]
    return tabs


def _view(name: str) -> Any:
    import rerun.blueprint as rrb

    title = name.split("/", 1)[1]
    hidden = rrb.PlotLegend(visible=False)
    return rrb.TimeSeriesView(name=title, contents=path(*name.split("/")), plot_legend=hidden, axis_x=_whole())


def _whole() -> Any:
    """A time axis that shows the whole run while it is played."""
    import rerun as rr
    import rerun.blueprint as rrb

    ends = rr.TimeRangeBoundary.infinite()
    return rrb.TimeAxis(view_range=rr.TimeRange(start=ends, end=ends))


def _grid(name: str, views: Sequence[Any]) -> Any:
    import rerun.blueprint as rrb

    return rrb.Grid(*views, name=name, grid_columns=min(len(views), 2 if len(views) <= 4 else 3))


def _eye(view: View) -> Any:
    """An eye that sees what a picture of this view shows, from the picture's side."""
    import rerun.blueprint as rrb

    right, up, away = view.axes
    low, high = np.array(view.low), np.array(view.high)
    middle = (low + high) / 2
    target = middle[0] * right + middle[1] * up
    far = 0.6 * float(np.max(high - low)) / math.tan(math.radians(27.5))
    return rrb.EyeControls3D(position=target - far * away, look_target=target, eye_up=up)
