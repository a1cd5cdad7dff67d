"""posterior.html: what a log says of each parameter, of each model that it leaves open; one file, without a network."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

from onlinebayes.identification import Estimate, quantities
from onlinebayes.posterior import LogPosterior, ParameterBelief, names_of, words
from onlinebayes.report import phrases
from onlinebayes.report.html import PAGE
from onlinebayes.report.markup import Html, chapter, join, prose, section, table, tag, text
from onlinebayes.report.sections.parameters import strip
from onlinebayes.report.style import stylesheet
from onlinebayes.runs import write_atomic

NAME = "posterior.html"

LEAST_CORRELATION = 0.5
"""Of two parameters that are listed as moving together."""

PAIRS = 12

STYLE = ".corner { background: #fff; padding: 8px; max-width: 100%; }\n"


def write_posterior_page(
    models: Sequence[LogPosterior], pictures: Sequence[bytes], out_dir: str | Path, *, title: str = ""
) -> str:
    """Write the page, beside the files of :func:`~onlinebayes.posterior.write_posterior`; returns its name."""
    write_atomic(Path(out_dir) / NAME, to_page(models, pictures, title=title))
    return NAME


def to_page(models: Sequence[LogPosterior], pictures: Sequence[bytes], *, title: str = "") -> str:
    """The whole page.

    Args:
        models: the posterior, or one for each model that the log leaves open.
        pictures: the corner plot of each, PNG.
        title: what was measured.
    """
    head = headline(models)
    parts = [
        tag("p", "onlinebayes posterior", f" · {title}" if title else "", kind="source"),
        tag("h1", prose(head)),
        *(
            chapter(f"model-{k}", _heading(one, len(models)), *_model(one, picture, names_of(k)[2 * k - 2]))
            for k, (one, picture) in enumerate(zip(models, pictures, strict=True), 1)
        ),
    ]
    name = f"{title or 'onlinebayes'}: {head}"
    return PAGE.format(title=text(name), style=stylesheet() + STYLE, body=Html("\n".join(parts)))


def headline(models: Sequence[LogPosterior]) -> str:
    """How much of the parameters is known."""
    if len(models) > 1:
        return f"The log leaves {len(models)} models open"
    if models[0].surprise < words.CERTAIN:
        return "The model cannot have made this log: its values need not be the machine's"
    found = models[0].identifiability
    open_, of = len(found.unknown), len(found.parameters)
    if not open_:
        return "Every parameter is known by itself" if of > 1 else "The parameter is known"
    return f"{of - open_} of {of} parameters {'is' if of - open_ == 1 else 'are'} known by themselves"


def _heading(one: LogPosterior, models: int) -> str:
    name = phrases.effects_in_words(one.accepted) if one.accepted else "the model as it is"
    if models > 1:
        return f"{quantities.percent(one.weight)}: {name}"
    return f"With {name}" if one.accepted else "Parameters"


def _model(found: LogPosterior, picture: bytes, belief: str) -> list[Html]:
    """What one model's posterior says."""
    said = words.alarm(found)
    return [
        tag("p", prose(said[:1].upper() + said[1:] + "."), kind="warning") if said else Html(""),
        _parameters(found),
        _together(found),
        _worlds(found),
        _corner(picture),
        _use(belief),
        *(tag("p", prose(note), kind="note") for note in words.notes(found)),
        _method(found),
    ]


def _parameters(found: LogPosterior) -> Html:
    """Every parameter, the least known first."""
    known, space = found.identifiability.known, found.space
    rows = []
    for name, value in sorted(found.parameters.items(), key=lambda one: -one[1].of_prior):
        estimate = _estimate(value, name in known)
        rows.append(
            (
                tag("code", name),
                tag("strong", quantities.with_error(value.mean, value.sd, value.unit)),
                phrases.interval(estimate),
                strip(name, estimate, space[name], None),
                quantities.percent(min(value.of_prior, 1.0)),
            )
        )
    note = (
        "Mean ± standard deviation of the posterior. The grey bar is what was allowed before the data; the coloured "
        "part is the 90 % interval after them, the line the mean."
    )
    head = ("parameter", "value", "90 % interval", "within what was allowed", "of the prior's width")
    return section("Values and intervals", table("Parameters, the least known first", head, rows), note=note)


def _estimate(value: ParameterBelief, known: bool) -> Estimate:
    return Estimate(value.mean, value.sd, value.q05, value.q95, value.unit, known)


def _together(found: LogPosterior) -> Html:
    """What is known only together, and what moves together."""
    rows = [(tag("code", one.words), quantities.percent(one.width)) for one in found.identifiability.combinations]
    names = found.space.names
    pairs = [
        (abs(float(found.correlation[i, j])), float(found.correlation[i, j]), names[i], names[j])
        for i in range(len(names))
        for j in range(i)
    ]
    strong = sorted((pair for pair in pairs if pair[0] >= LEAST_CORRELATION), reverse=True)
    linked = [(join(tag("code", b), " and ", tag("code", a)), f"{r:+.2f}") for _, r, a, b in strong[:PAIRS]]
    parts = []
    if rows:
        parts.append(table("Known only together", ("combination", "left of the prior's width"), rows))
    if linked:
        parts.append(table("Parameters that move together", ("parameters", "correlation"), linked))
    if len(strong) > PAIRS:
        parts.append(tag("p", f"{len(strong) - PAIRS} more pairs stand in posterior.json.", kind="note"))
    return section("What is known together", *parts) if parts else Html("")


def _worlds(found: LogPosterior) -> Html:
    """How well draws of the posterior follow each signal."""
    rows = []
    for signal, value in found.reproduction.items():
        scale = quantities.scale_for(value.rms, value.unit)
        span = f"{scale.number(value.q05)} to {scale.text(value.q95)}"
        rows.append((tag("code", signal), scale.text(value.rms), span, scale.text(value.noise)))
    if not rows:
        return tag("p", "No world of this model follows the log.", kind="note")
    head = ("signal", "error", "of 90 % of the worlds", "sensor noise")
    return section("How its worlds follow the log", table("Error of worlds drawn from the posterior", head, rows))


def _corner(picture: bytes) -> Html:
    data = base64.b64encode(picture).decode("ascii")
    image = Html(f'<img class="corner" alt="Corner plot of the posterior" src="data:image/png;base64,{data}">')
    return section("Its distribution", tag("figure", image))


def _use(belief: str) -> Html:
    code = (
        f'from onlinebayes.inference import saving\n\nbelief = saving.load("{belief}")\ntheta = belief.sample((64,))\n'
    )
    return section("Draw from it", tag("pre", tag("code", code)))


def _method(found: LogPosterior) -> Html:
    method = found.method
    told = (
        f"{method.draws} replays of {method.windows} windows of {quantities.exact(method.horizon_s, 's')} from "
        f"{phrases.listing(list(method.runs))}, worth {method.effective:.0f} equal draws."
    )
    return tag("p", prose(told), kind="note")
