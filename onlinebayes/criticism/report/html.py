"""report.html: one file, no script, no network, light and dark, printable.

The first screen answers four questions: how wrong is the model, where, what is missing, how much better is it now.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Final

from onlinebayes.criticism.report import words
from onlinebayes.criticism.report.markup import Html, tag, text
from onlinebayes.criticism.report.sections import errors, parameters, ranking, summary, usage
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
<main>
{body}
</main>
</body>
</html>
"""
"""The frame of a page: ``title``, ``style``, ``body``."""


def to_html(
    result: Criticism, *, title: str = "", refined: tuple[str, ...] = (), left_out: tuple[str, ...] = ()
) -> str:
    """The whole page.

    Args:
        result: what to report.
        title: what was criticised, e.g. the name of the problem file.
        refined: names of the refined model's files that stand beside the report.
        left_out: keys of the effects that refined.xml cannot hold.
    """
    style = files("onlinebayes.criticism.report").joinpath("style.css").read_text(encoding="utf-8")
    parts = [
        tag("p", f"onlinebayes {result.command}", f" · {title}" if title else "", kind="source"),
        summary.render(result),
        summary.heldout(result),
        usage.advice(result, refined, left_out),
        ranking.render(result),
        parameters.render(result),
        errors.render(result),
        usage.provenance(result),
    ]
    head = text(f"{title or 'onlinebayes'}: {words.headline(result)}")
    return PAGE.format(title=head, style=style, body=Html("\n".join(part for part in parts if part)))
