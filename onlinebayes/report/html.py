"""report.html: one file, no script, no network, light and dark, printable.

The first screen answers four questions: how wrong is the model, where, what is missing, how much better is it now.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from onlinebayes.criticism import Criticism
from onlinebayes.report import words
from onlinebayes.report.markup import Html, chapter, join, tag, text
from onlinebayes.report.sections import accuracy, errors, parameters, ranking, summary, usage, where
from onlinebayes.report.style import stylesheet
from onlinebayes.runs import Attempts

Part = tuple[str, Callable[[], Html]]
"""The content that a part of the page shows, in words, and the function that makes it."""

PAGE: Final = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<a class="skip" href="#main">Skip to the answer</a>
<main id="main" tabindex="-1">
{body}
</main>
</body>
</html>
"""
"""The frame of a page: ``title``, ``style``, ``body``."""


def to_html(
    result: Criticism,
    *,
    title: str = "",
    refined: tuple[str, ...] = (),
    left_out: Mapping[str, str] | None = None,
    lost: Mapping[str, str] | None = None,
    attempts: Attempts | None = None,
) -> str:
    """The whole page.

    Args:
        result: what to report.
        title: what was criticised, e.g. the name of the problem file.
        refined: names of the refined model's files that stand beside the report.
        left_out: keys of the effects that refined.xml cannot hold -> why.
        lost: those that refined_model.py cannot hold either -> why.
        attempts: takes what fails: a line stands in the place of such a part; the failure is raised where there is
            none.
    """
    chapters = [
        chapter(name, heading, *(_part(what, make, attempts) for what, make in parts))
        for name, heading, parts in _parts(result, usage.Files(refined, left_out or {}, lost or {}))
    ]
    body = [
        tag("p", f"onlinebayes {result.command}", f" · {title}" if title else "", kind="source"),
        _part("the headline", lambda: summary.headline(result), attempts),
        _contents(chapters),
        *chapters,
    ]
    name = title or "onlinebayes"
    head = _part("the title", lambda: text(f"{name}: {words.headline(result)}"), attempts, text(name))
    return PAGE.format(title=head, style=stylesheet(), body=Html("\n".join(part for part in body if part)))


def _parts(result: Criticism, files: usage.Files) -> tuple[tuple[str, str, tuple[Part, ...]], ...]:
    """Name, heading and parts of every chapter."""
    return (
        (
            "answer",
            "Before and after",
            (
                ("the figures", lambda: summary.tiles(result)),
                ("the picture of the error", lambda: accuracy.picture(result)),
                ("the held-out error", lambda: accuracy.heldout(result)),
            ),
        ),
        (
            "where",
            "Where the model fails",
            (
                ("the picture of the worst window", lambda: summary.picture(result)),
                ("the error's profiles", lambda: where.profiles(result)),
                ("the regions of the error", lambda: errors.failures(result)),
                ("the error by horizon", lambda: where.horizons(result)),
                ("the worst windows", lambda: where.worst(result)),
                ("the error along the runs", lambda: errors.along(result)),
                ("what is left", lambda: errors.remainder(result)),
            ),
        ),
        ("candidates", "What could be missing", (("the candidates", lambda: ranking.render(result)),)),
        ("parameters", "Parameters", (("the parameters", lambda: parameters.render(result)),)),
        ("next", "What to do next", (("the advice", lambda: usage.advice(result, files)),)),
        ("how", "How this was reached", (("how this was reached", lambda: usage.provenance(result)),)),
    )


def _part(what: str, make: Callable[[], Html], attempts: Attempts | None, instead: Html | None = None) -> Html:
    """A part of the page; where it fails ``instead``, or the line that says so."""
    if attempts is None:
        return make()
    with attempts.attempt(f"{what} (report.html)"):
        return make()
    return tag("p", attempts.failed[-1], kind="note") if instead is None else instead


def _contents(chapters: list[Html]) -> Html:
    """Links to the chapters that are there."""
    links = [
        Html(f'<a href="#{name}">{label}</a>')
        for (name, label), content in zip(_CHAPTERS.items(), chapters, strict=True)
        if content
    ]
    return Html(f'<nav aria-label="Contents">{join(*links)}</nav>')


_CHAPTERS: Final = {
    "answer": "Answer",
    "where": "Where",
    "candidates": "Candidates",
    "parameters": "Parameters",
    "next": "Next",
    "how": "How",
}
