"""report.html: one file, no script, no network, light and dark, printable.

The first screen answers four questions: how wrong is the model, where, what is missing, how much better is it now.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from onlinebayes.criticism.report import words
from onlinebayes.criticism.report.markup import Html, chapter, join, tag, text
from onlinebayes.criticism.report.sections import accuracy, errors, parameters, ranking, summary, usage, where
from onlinebayes.criticism.report.style import stylesheet
from onlinebayes.criticism.results import Criticism

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
    result: Criticism, *, title: str = "", refined: tuple[str, ...] = (), left_out: Mapping[str, str] | None = None
) -> str:
    """The whole page.

    Args:
        result: what to report.
        title: what was criticised, e.g. the name of the problem file.
        refined: names of the refined model's files that stand beside the report.
        left_out: keys of the effects that refined.xml cannot hold -> why.
    """
    style = stylesheet()
    chapters = [
        chapter(
            "answer", "Before and after", summary.tiles(result), accuracy.picture(result), accuracy.heldout(result)
        ),
        chapter("where", "Where the model fails", *_where(result)),
        chapter("candidates", "What could be missing", ranking.render(result)),
        chapter("parameters", "Parameters", parameters.render(result)),
        chapter("next", "What to do next", usage.advice(result, refined, left_out or {})),
        chapter("how", "How this was reached", usage.provenance(result)),
    ]
    parts = [
        tag("p", f"onlinebayes {result.command}", f" · {title}" if title else "", kind="source"),
        summary.headline(result),
        _contents(chapters),
        *chapters,
    ]
    head = text(f"{title or 'onlinebayes'}: {words.headline(result)}")
    return PAGE.format(title=head, style=style, body=Html("\n".join(part for part in parts if part)))


def _where(result: Criticism) -> tuple[Html, ...]:
    return (
        summary.picture(result),
        where.profiles(result),
        errors.failures(result),
        where.horizons(result),
        where.worst(result),
        errors.along(result),
        errors.remainder(result),
    )


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
