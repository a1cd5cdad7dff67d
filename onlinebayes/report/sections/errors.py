"""Regions in which the error concentrates, what is left of it, and the error along whole runs."""

from __future__ import annotations

from onlinebayes.criticism import Criticism
from onlinebayes.identification import quantities
from onlinebayes.report import phrases, region_words, replays, svg, words
from onlinebayes.report.markup import Html, bar, folded, join, section, table, tag, wide
from onlinebayes.report.sections.summary import legend

RUNS_SHOWN, RUNS_OPEN, ROWS_SHOWN = 6, 2, 8


def failures(result: Criticism) -> Html:
    """The regions that hold more of the base model's error than of the time, the first few open."""
    if not result.failures:
        return Html("")
    rows = [
        (
            join(region_words.in_words(failure.where), tag("small", tag("code", failure.where))),
            tag("code", failure.signal),
            bar(failure.share_of_error, "before", quantities.percent(failure.share_of_error)),
            bar(failure.share_of_time, "floor", quantities.percent(failure.share_of_time)),
        )
        for failure in result.failures
    ]
    head = ("where", "signal", "share of the squared error", "share of the time")
    note = "Regions in which the base model is wrong more often than they occur, in the fit runs."
    first, more = rows[:ROWS_SHOWN], rows[ROWS_SHOWN:]
    shown = table("Share of error against share of time", head, first)
    rest = folded(f"{len(more)} more regions", table("More regions", head, more)) if more else ""
    return section("Where the error concentrates", shown, rest, note=note)


def remainder(result: Criticism) -> Html:
    """Show the residual that the final model leaves, signal by signal, the largest first."""
    left = sorted(result.remainder.rms_over_floor.items(), key=lambda item: -item[1])
    rows = [
        (
            tag("code", signal),
            quantities.times(ratio),
            quantities.text(result.sensor_sd.get(signal), result.units.get(signal, "")),
        )
        for signal, ratio in left
    ]
    note = "Residual of the final model in the fit runs, with free window starts, against the floor of its sensor."
    head = ("signal", "residual over floor", "sensor noise (sd)")
    shown = table("Residual over floor", head, rows[:ROWS_SHOWN])
    more = rows[ROWS_SHOWN:]
    rest = folded(f"{len(more)} more signals", table("Residual over floor, the others", head, more)) if more else ""
    return section("What is left", tag("p", words.remainder(result)), shown, rest, note=note)


def along(result: Criticism) -> Html:
    """Simulated minus measured along each run, before and after."""
    signal = words.worst_signal(result)
    unit, charts = result.units[signal], []
    found = replays.traces(result, signal)
    for trace in found[:RUNS_SHOWN]:
        errors = {"before": trace.before - trace.measured, "after": trace.after - trace.measured}
        scale = quantities.scale_for(svg.largest(errors["before"]), unit)
        kinds = ("before", "after") if result.changed else ("before",)
        curves = [svg.Curve(trace.time, trace.broken(errors[k]) / scale.size, k, f"error {k}") for k in kinds]
        floor = result.heldout_error.noise_floor[signal] / scale.size
        panel = svg.Panel(curves, f"error [{scale.unit}]", 110, band=floor)
        name = f"{trace.run}{' (held out)' if trace.held_out else ''}"
        chart = svg.chart([panel], "time [s]", title=f"error of {signal} along run {name}")
        charts.append(tag("figure", tag("h4", name), wide(chart, f"error of {signal} along run {name}")))
    if not charts:
        return Html("")
    shown = [*charts[:RUNS_OPEN]]
    if charts[RUNS_OPEN:]:
        shown.append(folded(phrases.more(len(charts) - RUNS_OPEN, "run"), *charts[RUNS_OPEN:]))
    unseen = len(found) - RUNS_SHOWN
    left = f" {phrases.more(unseen, 'run')} {'is' if unseen == 1 else 'are'} in the recording." if unseen > 0 else ""
    horizon = quantities.exact(result.heldout_error.horizon_s[signal], "s")
    note = f"Simulated minus measured {signal}; every {horizon} the model starts again from the measured state.{left}"
    return section("The error along the runs", legend(result.changed, ("before", "after", "floor")), *shown, note=note)
