"""Places of the misfit: by what the machine did, in its worst windows, and with the time for which it runs freely."""

from __future__ import annotations

import numpy as np

from onlinebayes.criticism import Criticism
from onlinebayes.identification import HorizonError, quantities
from onlinebayes.report import multiples, replays, svg, words
from onlinebayes.report.markup import Html, folded, join, prose, section, tag, wide
from onlinebayes.report.sections.summary import legend

SIGNALS_OPEN = 2
"""Signals whose pictures are shown; those of the others are folded away."""
WINDOWS_SHOWN = 6
OVERLAID = 3


def profiles(result: Criticism) -> Html:
    """Small pictures of the shares of error, the most telling first, the worst signals open."""
    order = words.signals_by_error(result)
    shown = [(signal, _multiples(result, signal)) for signal in order]
    shown = [(signal, content) for signal, content in shown if content]
    if not shown:
        return Html("")
    several = len(shown) > 1
    parts = [join(tag("h4", tag("code", s)) if several else "", content) for s, content in shown[:SIGNALS_OPEN]]
    rest = [join(tag("h4", tag("code", s)), content) for s, content in shown[SIGNALS_OPEN:]]
    parts += [folded(f"{len(rest)} more signals, by what the machine did", *rest)] if rest else []
    note = (
        "Grey: how much of the time the machine spent there. Coloured: how much of the squared error fell there. Where "
        "the coloured bar is the taller one, the model is wrong more often than it is there. All runs."
    )
    kinds = ("time", "before", "after")
    return section("By what the machine did", legend(result.changed, kinds), *parts, note=note)


def _multiples(result: Criticism, signal: str) -> Html:
    mine = sorted((p for p in result.detail.profiles if p.signal == signal), key=lambda p: -p.concentration)
    pictures = [
        tag(
            "figure",
            tag("figcaption", tag("b", multiples.title(profile)), tag("span", prose(multiples.telling(profile)))),
            Html(multiples.draw(profile, result.changed)),
        )
        for profile in mine
    ]
    return tag("div", *pictures, kind="multiples") if pictures else Html("")


def horizons(result: Criticism) -> Html:
    """Error against the time since a window's start, the worst windows overlaid; the worst signals open."""
    by_signal = {horizon.signal: horizon for horizon in result.detail.horizons}
    order = [signal for signal in words.signals_by_error(result) if signal in by_signal]
    charts = [(signal, _horizon(result, by_signal[signal])) for signal in order]
    if not charts:
        return Html("")
    parts = [content for _, content in charts[:SIGNALS_OPEN]]
    rest = [content for _, content in charts[SIGNALS_OPEN:]]
    parts += [folded(f"{len(rest)} more signals, by the time simulated", *rest)] if rest else []
    note = (
        "Each window starts from the measured state; then the model runs freely. Thick: root mean square over all "
        "held-out windows. Thin: the size of the error in the worst of them, before."
    )
    kinds = ("before", "after", "limit")
    return section("How fast the error grows", legend(result.changed, kinds), *parts, note=note)


def _horizon(result: Criticism, horizon: HorizonError) -> Html:
    kinds = ("before", "after") if result.changed else ("before",)
    time = np.asarray(horizon.time)
    worst = replays.worst_windows(replays.traces(result, horizon.signal), OVERLAID)
    sizes = [(trace.time - trace.time[0], np.abs(trace.before - trace.measured)) for trace in worst]
    largest = max(svg.largest(y) for y in [np.asarray(horizon.before), *(y for _, y in sizes)])
    scale = quantities.scale_for(largest, result.units[horizon.signal])
    curves = [svg.Curve(t, y / scale.size, "worst", "one of the worst windows") for t, y in sizes]
    curves += [svg.Curve(time, np.asarray(horizon.floor) / scale.size, "limit", "noise floor")]
    curves += [svg.Curve(time, np.asarray(getattr(horizon, k)) / scale.size, f"thick {k}", k) for k in kinds]
    ends = " → ".join(scale.text(getattr(horizon, kind)[-1]) for kind in kinds)
    title = f"Error of {horizon.signal} against the time simulated; at its end {ends}"
    panel = svg.Panel(curves, f"error [{scale.unit}]", 170)
    chart = svg.chart([panel], "time since the window's start [s]", title=title)
    caption = join(tag("code", horizon.signal), f": after {quantities.exact(round(horizon.time[-1], 3), 's')} {ends}")
    return tag("figure", wide(chart, title), tag("figcaption", caption))


def worst(result: Criticism) -> Html:
    """Measured and simulated in the worst windows of the worst signal, side by side."""
    signal = words.worst_signal(result)
    found = replays.worst_windows(replays.traces(result, signal), WINDOWS_SHOWN)
    if len(found) < 2:
        return Html("")
    unit, pictures = result.units[signal], []
    for trace in found:
        scale = quantities.scale_for(svg.largest(trace.measured), unit)
        kinds = ("measured", "before", "after") if result.changed else ("measured", "before")
        curves = [svg.Curve(trace.time, getattr(trace, kind) / scale.size, kind, kind) for kind in kinds]
        title = f"{signal} in run {trace.run} from {trace.time[0]:.2f} s: measured and simulated"
        chart = svg.chart([svg.Panel(curves, f"[{scale.unit}]", 110)], "time [s]", width=380, title=title)
        caption = tag("b", f"{trace.run}, {trace.time[0]:.1f} s")
        pictures.append(tag("figure", tag("figcaption", caption, tag("span", _better(trace, unit))), Html(chart)))
    note = "The windows in which the base model is furthest off; held-out ones where there are any."
    shown = (legend(result.changed, ("measured", "before", "after")), tag("div", *pictures, kind="multiples large"))
    return section(f"The worst windows of {signal}", *shown, note=note)


def _better(trace: replays.Trace, unit: str) -> str:
    before, after = (
        float(np.sqrt(np.nanmean((values - trace.measured) ** 2))) for values in (trace.before, trace.after)
    )
    same = np.array_equal(trace.before, trace.after, equal_nan=True)
    return f"error {' → '.join(quantities.texts((before,) if same else (before, after), unit))}"
