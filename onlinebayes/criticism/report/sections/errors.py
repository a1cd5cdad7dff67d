"""Where the error concentrates and what is left: regions, the remainder, and the error along whole runs."""

from __future__ import annotations

from onlinebayes.criticism.report import quantities, replays, svg, words
from onlinebayes.criticism.report.markup import Html, bar, join, section, table, tag
from onlinebayes.criticism.report.sections.summary import legend
from onlinebayes.criticism.results import Criticism

RUNS_SHOWN = 6


def render(result: Criticism) -> Html:
    """Regions, remainder, error along the runs."""
    return join(_failures(result), _remainder(result), _along(result))


def _failures(result: Criticism) -> Html:
    if not result.failures:
        return Html("")
    rows = [
        (
            tag("code", failure.signal),
            tag("code", failure.where),
            bar(failure.share_of_error, "before", quantities.percent(failure.share_of_error)),
            bar(failure.share_of_time, "floor", quantities.percent(failure.share_of_time)),
        )
        for failure in result.failures
    ]
    head = ("signal", "where", "share of the squared error", "share of the time")
    note = "Regions in which the base model is wrong more often than they occur."
    return section("Where the error concentrates", table(head, rows), note=note)


def _remainder(result: Criticism) -> Html:
    rows = [
        (
            tag("code", signal),
            quantities.times(ratio),
            quantities.text(result.sensor_sd.get(signal), result.units.get(signal, "")),
        )
        for signal, ratio in result.remainder.rms_over_floor.items()
    ]
    note = "Residual of the final model in the fit runs, with free window starts, against the floor of its sensor."
    head = ("signal", "residual over floor", "sensor noise (sd)")
    return section("What is left", tag("p", words.remainder(result)), table(head, rows), note=note)


def _along(result: Criticism) -> Html:
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
        charts.append(tag("figure", tag("h3", name), Html(chart)))
    if not charts:
        return Html("")
    left = f" {len(found) - RUNS_SHOWN} more runs are in the recording." if len(found) > RUNS_SHOWN else ""
    horizon = quantities.exact(result.heldout_error.horizon_s[signal], "s")
    note = f"Simulated minus measured {signal}; every {horizon} the model starts again from the measured state.{left}"
    return section("The error along the runs", legend(result.changed, ("before", "after", "floor")), *charts, note=note)
