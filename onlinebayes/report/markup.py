"""The few pieces of HTML that the sections share. Text that comes from a user is escaped here, not by the sections."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape


class Html(str):
    """Text that is HTML already; everything else is escaped when it is put in."""

    __slots__ = ()


def text(content: str) -> Html:
    """``content`` as HTML; what is HTML already stays."""
    return content if isinstance(content, Html) else Html(escape(content, quote=True))


def prose(content: str) -> Html:
    """A sentence whose numbers stay with their units when the line breaks."""
    return Html(re.sub(r"(?<!\w)(\d[\d.]*) (?=[a-zA-Zµ%])", r"\1&nbsp;", text(content)))


def breakable(name: str) -> Html:
    """A long name that may break behind its separators and nowhere else."""
    return Html(re.sub(r"([@._])", r"\1<wbr>", text(name)))


def tag(name: str, *content: str, kind: str = "") -> Html:
    """``<name class=kind>content</name>``."""
    css = f' class="{kind}"' if kind else ""
    return Html(f"<{name}{css}>{''.join(text(item) for item in content)}</{name}>")


def join(*content: str) -> Html:
    """Pieces one after the other."""
    return Html("".join(text(item) for item in content))


def chapter(name: str, title: str, *content: str) -> Html:
    """One of the page's main parts, with a heading that links can reach; nothing where it has no content."""
    inner = join(*content)
    if not inner:
        return Html("")
    return Html(
        f'<section id="{name}" aria-labelledby="{name}-title"><h2 id="{name}-title">{text(title)}</h2>{inner}</section>'
    )


def section(title: str, *content: str, note: str = "") -> Html:
    """A headed part of a chapter; ``note`` says under the heading how to read it."""
    return tag("section", tag("h3", title), tag("p", note, kind="note") if note else "", *content)


def folded(title: str, *content: str) -> Html:
    """Fold content that only some readers want: closed until its title is clicked; open on paper."""
    return tag("details", tag("summary", title), *content)


def table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]], kinds: Sequence[str] = ()) -> Html:
    """A table with its caption; the first cell of a row is its head, ``kinds`` gives a CSS class for each row.

    Wide tables scroll within a region of their own, which the keyboard reaches; on a narrow screen a row is a card.
    """
    kinds = kinds or [""] * len(rows)
    heads = "".join(f'<th scope="col">{text(cell)}</th>' for cell in head)
    body = [
        tag("tr", Html(f'<th scope="row">{text(row[0])}</th>'), *_cells(row, head), kind=kind)
        for row, kind in zip(rows, kinds, strict=True)
    ]
    inner = tag("table", tag("caption", caption), Html(f"<thead><tr>{heads}</tr></thead>"), tag("tbody", *body))
    return Html(f'<div class="scroll" role="region" tabindex="0" aria-label="{text(caption)}">{inner}</div>')


def _cells(row: Sequence[str], head: Sequence[str]) -> list[Html]:
    """The cells after a row's first, each with its column's name, which a narrow screen shows before it."""
    return [Html(f'<td data-of="{text(name)}">{text(cell)}</td>') for cell, name in zip(row[1:], head[1:], strict=True)]


def wide(drawing: str, label: str) -> Html:
    """A wide drawing, which on a narrow screen scrolls within a region of its own instead of shrinking out of sight."""
    return Html(f'<div class="scroll" role="region" tabindex="0" aria-label="{text(label)}">{drawing}</div>')


def bar(share: float, kind: str = "", label: str = "", error: float = 0.0) -> Html:
    """A horizontal bar of ``share`` in 0..1 of its cell, with a whisker of ``error`` to both sides, and its label."""
    share, low, high = (min(max(x, 0.0), 1.0) for x in (share, share - error, share + error))
    whisker = f'<i style="left:{100 * low:.1f}%;width:{100 * (high - low):.1f}%"></i>' if error > 0 else ""
    inner = f'<span class="track"><b class="{kind}" style="width:{100 * share:.1f}%"></b>{whisker}</span>'
    return Html(f'<span class="bar">{inner}<span>{text(label)}</span></span>')
