"""The first screen: how wrong the model is, where, what is missing, how much better it is now; the worst window."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from onlinebayes.criticism import Candidate, Criticism
from onlinebayes.identification import quantities
from onlinebayes.report import candidate_words, phrases, region_words, replays, svg, words
from onlinebayes.report.markup import Html, bar, join, prose, tag, wide

SIZES = 5
"""The most values of effects in a tile or a row: the parameters have a table of their own."""


def headline(result: Criticism) -> Html:
    """The verdict, the headline, and the answer in two sentences."""
    lead = tag("p", prose(f"{words.improvement(result)} {words.remainder(result)}"), kind="lead")
    badge = tag("span", words.VERDICTS[result.verdict], kind=f"badge {result.verdict}")
    if result.only_compared:
        badge = tag("span", "compared", kind="badge")
    stopped = "It was stopped before the wiring check; this is the model as it was fitted."
    if result.command != "compare":
        stopped = "The search was stopped before its end; this is what it had found."
    notes = tag("p", stopped, kind="warning")
    return join(
        tag("p", badge),
        tag("h1", prose(words.headline(result))),
        lead,
        notes if result.interrupted else "",
    )


def tiles(result: Criticism) -> Html:
    """Four questions and their answers."""
    return tag("div", _wrong(result), _where(result), _missing(result), _better(result), kind="tiles")


def picture(result: Criticism) -> Html:
    """Measured against simulated in the window where the base model is worst, with the errors below."""
    signal = words.worst_signal(result)
    worst = replays.worst_window(replays.traces(result, signal))
    if worst is None:
        return Html("")
    unit, changed = result.units[signal], result.changed
    kinds = ("before", "after") if changed else ("before",)
    values = {"before": worst.before, "after": worst.after}
    span = float(np.nanmax(np.abs(worst.measured - np.nanmean(worst.measured)))) or 1.0
    outer = quantities.scale_for(span, unit)
    inner = quantities.scale_for(float(np.nanmax(np.abs(worst.before - worst.measured))), unit)
    curves = [svg.Curve(worst.time, worst.measured / outer.size, "measured", "measured")]
    curves += [svg.Curve(worst.time, values[kind] / outer.size, kind, _LABELS[kind]) for kind in kinds]
    errors = [svg.Curve(worst.time, (values[k] - worst.measured) / inner.size, k, f"error {k}") for k in kinds]
    floor = result.heldout_error.noise_floor[signal] / inner.size
    chart = svg.chart(
        [
            svg.Panel(curves, f"{signal} [{outer.unit}]", 190),
            svg.Panel(errors, f"error [{inner.unit}]", 120, band=floor),
        ],
        "time [s]",
        title=f"{signal}, measured and simulated, in the worst window of run {worst.run}",
    )
    kept = "held-out run" if worst.held_out else "run"
    caption = f"The window in which the model is furthest off: {kept} “{worst.run}”, both models started alike."
    return tag("figure", legend(changed), wide(chart, f"{signal} in the worst window"), tag("figcaption", caption))


def legend(changed: bool, kinds: tuple[str, ...] = ("measured", "before", "after", "floor")) -> Html:
    """Explain the colours; there is one model only where nothing was ``changed``."""
    labels = _LABELS if changed else {**_LABELS, "before": "model"}
    shown = [kind for kind in kinds if changed or kind != "after"]
    return tag("p", *(tag("span", labels[kind], kind=f"key {kind}") for kind in shown), kind="legend")


_LABELS = {
    "measured": "measured",
    "before": "model before",
    "after": "model after",
    "floor": "noise floor",
    "limit": "noise floor",
    "time": "share of time",
}


def _tile(question: str, answer: str, detail: str) -> Html:
    return tag("div", tag("h3", question), tag("p", prose(answer), kind="answer"), tag("p", prose(detail)), kind="tile")


def _wrong(result: Criticism) -> Html:
    signal = words.worst_signal(result)
    errors = result.heldout_error
    before, floor = quantities.texts((errors.before[signal], errors.noise_floor[signal]), result.units[signal])
    known = errors.noise_floor[signal] > 0
    return _tile(
        "How wrong is the model?",
        before,
        f"{signal}, RMS over {quantities.exact(errors.horizon_s[signal], 's')} of held-out data: "
        f"{phrases.times_floor(words.over_floor(result, signal))}{f' ({floor})' if known else ''}",
    )


def _where(result: Criticism) -> Html:
    if not result.failures:
        return _tile("Where?", "everywhere alike", "no region holds much more of the error than of the time")
    worst = result.failures[0]
    share, time = quantities.percent(worst.share_of_error), quantities.percent(worst.share_of_time)
    return _tile(
        "Where?",
        region_words.in_words(worst.where),
        f"{share} of the squared error of {worst.signal} in {time} of the time (before, runs of the fit)",
    )


def _missing(result: Criticism) -> Html:
    question = "What is missing?"
    if result.command == "compare":
        return _tile(question, "not asked", "onlinebayes diagnose ranks what could be missing, refine adds it")
    if result.verdict == "tie":
        members = phrases.effects_in_words(candidate_words.tie_members(result), "or")
        return _tile(question, members, "the data cannot tell these apart")
    if result.verdict == "insufficient_data":
        return _tile(question, "not decided", result.what_to_record or "the measurements are too few")
    if result.verdict == "data_problem" and result.wiring:
        return _tile("What is wrong?", "the data", words.wiring(result))
    if result.widened:
        return _tile("What is wrong?", "a bound excludes the truth", join(*map(_line, words.bounds(result))))
    if result.changes and not result.accepted:
        return _tile("What is wrong?", "a parameter differs between runs", join(*map(_line, words.changes(result))))
    if not result.accepted:
        tried = f"{result.candidates_tried} effects were tried, none was accepted"
        return _tile(question, "nothing" if result.verdict == "adequate" else "no known effect", tried)
    by_effect = {c.effect: c for c in result.candidates if c.accepted}
    found = [by_effect[effect] for effect in result.accepted if effect in by_effect]
    return _tile(question, phrases.effects_in_words(result.accepted), sizes(found))


def sizes(candidates: Sequence[Candidate], intervals: bool = False) -> Html:
    """A line for each parameter of these effects: its name and what the data say of it; the first few of many."""
    lines = [
        tag(
            "span",
            f"{name} ",
            tag("span", phrases.estimate(value), kind="number"),
            tag("small", f"90 %: {phrases.interval(value)}") if intervals else "",
            kind="line",
        )
        for candidate in candidates
        for name, value in candidate.parameters.items()
    ]
    if len(lines) > SIZES:
        lines = [*lines[:SIZES], tag("span", f"and {len(lines) - SIZES} more values", kind="line")]
    return join(*lines)


def _line(sentence: str) -> Html:
    return tag("span", prose(sentence), kind="line")


def _better(result: Criticism) -> Html:
    signal = words.worst_signal(result)
    errors, unit = result.heldout_error, result.units[signal]
    before, after, floor = errors.before[signal], errors.after[signal], errors.noise_floor[signal]
    if result.command == "compare":
        return Html("")
    if not result.changed:
        ratio = result.remainder.rms_over_floor.get(signal, float("nan"))
        return _tile(
            "How much better now?", "unchanged", f"nothing was added; the residual is {phrases.times_floor(ratio)}"
        )
    values = {"before": before, "after": after, "floor": floor}
    largest, shown = max(values.values()), quantities.texts(tuple(values.values()), unit)
    bars = join(
        *(
            bar(value / largest, kind, f"{kind} {said}")
            for (kind, value), said in zip(values.items(), shown, strict=True)
        )
    )
    return tag(
        "div",
        tag("h3", "How much better now?"),
        tag("p", phrases.better(before, after), kind="answer"),
        bars,
        kind="tile",
    )
