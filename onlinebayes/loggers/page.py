"""run.html: a run on one page that needs nothing but a browser; charts, pictures and films stand in the file itself."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from onlinebayes.loggers.charts import COLOURS, Curves, to_svg
from onlinebayes.runs import write_atomic

__all__ = ["Curves", "Film", "Page", "to_html", "write_page"]

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #22262d; max-width: 62rem; margin: 2rem auto 4rem; padding: 0 1rem }
h1 { font-size: 1.7rem; margin-bottom: 0 } h2 { font-size: 1.15rem; margin: 2.2rem 0 .6rem }
p.lead { color: #5b626d; margin-top: .2rem }
table { border-collapse: collapse; margin: 1.2rem 0 } td, th { padding: .3rem 1.6rem .3rem 0; text-align: right }
th { color: #5b626d; font-weight: 500 } tr { border-bottom: 1px solid #e3e6ea }
td { font-variant-numeric: tabular-nums } td:first-child, th:first-child { text-align: left }
img, svg { max-width: 100%; height: auto }
figure { margin: 0 } figcaption { color: #5b626d; font-size: .92rem }
.charts { display: grid; grid-template-columns: repeat(auto-fill, minmax(17rem, 1fr)); gap: 1.2rem }
.bar { display: flex; height: 1.3rem; border-radius: 3px; overflow: hidden } .bar span { display: block }
dl { display: grid; grid-template-columns: max-content auto; gap: .2rem 1.4rem; font-size: .92rem }
dt { color: #5b626d } dd { margin: 0; overflow-wrap: anywhere }
ul.notes { color: #5b626d; font-size: .92rem; padding-left: 1.2rem }
"""


@dataclass(frozen=True)
class Film:
    """Moving pictures.

    Args:
        frames: pixels, all of one size (H, W, 3).
        seconds: from one to the next [s].
    """

    frames: Sequence[UInt8[np.ndarray, "H W 3"]]
    seconds: float


@dataclass(frozen=True)
class Page:
    """Contents of the page.

    Args:
        title: of the run.
        lead: one line below it.
        head: of the table of parameters.
        rows: of it.
        charts: in order.
        pictures: caption -> pixels (H, W, 3).
        seconds: part -> seconds in all.
        notes: one line each.
        films: caption -> film; it plays without end.
        made: how the run was made: what is said -> its value.
    """

    title: str
    lead: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    charts: Sequence[Curves]
    pictures: Mapping[str, np.ndarray]
    seconds: Mapping[str, float]
    notes: Sequence[str]
    films: Mapping[str, Film] = field(default_factory=dict)
    made: Mapping[str, str] = field(default_factory=dict)


def write_page(page: Page, path: str | Path) -> None:
    """Write the page, atomically."""
    write_atomic(path, to_html(page))


def to_html(page: Page) -> str:
    """The page as text."""
    parts = [f"<h1>{html.escape(page.title)}</h1>", f'<p class="lead">{html.escape(page.lead)}</p>']
    parts += [_table(page.head, page.rows)] if page.rows else []
    parts += ['<div class="charts">', *(f"<figure>{to_svg(chart)}</figure>" for chart in page.charts), "</div>"]
    for caption, film in page.films.items():
        parts += [_figure(caption, _animated(film))]
    for caption, pixels in page.pictures.items():
        parts += [_figure(caption, _png(pixels))]
    if page.seconds:
        parts += ["<h2>Where the time went</h2>", _bar(page.seconds)]
    if page.notes:
        notes = "".join(f"<li>{html.escape(note)}</li>" for note in page.notes)
        parts += ["<h2>What was decided, and what went wrong</h2>", f'<ul class="notes">{notes}</ul>']
    if page.made:
        parts += ["<h2>How it was made</h2>", _pairs(page.made)]
    meta = '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
    head = f"{meta}<title>{html.escape(page.title)}</title><style>{STYLE}</style>"
    return f"<!doctype html><html lang=en><head>{head}</head><body>{''.join(parts)}</body></html>\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    cells = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    lines = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{lines}</table>"


def _pairs(made: Mapping[str, str]) -> str:
    lines = "".join(f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in made.items())
    return f"<dl>{lines}</dl>"


def _figure(caption: str, source: str) -> str:
    return f'<h2>{html.escape(caption)}</h2><img alt="{html.escape(caption)}" src="{source}">'


def _bar(seconds: Mapping[str, float]) -> str:
    total = sum(seconds.values()) or 1.0
    pieces, words = [], []
    for i, (name, value) in enumerate(seconds.items()):
        colour = COLOURS[i % len(COLOURS)]
        pieces.append(f'<span style="width:{100 * value / total:.2f}%;background:{colour}"></span>')
        words.append(f'<span style="color:{colour}">■</span> {html.escape(name)} {value:.1f} s')
    return f'<div class="bar">{"".join(pieces)}</div><p>{" &nbsp; ".join(words)}</p>'


def _png(pixels: UInt8[np.ndarray, "H W 3"]) -> str:
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(pixels).save(data, format="PNG", optimize=True)
    return _embedded("png", data)


def _animated(film: Film) -> str:
    from PIL import Image

    data = io.BytesIO()
    first, *others = (Image.fromarray(frame).quantize(32) for frame in film.frames)
    first.save(data, format="GIF", save_all=True, append_images=others, duration=round(1000 * film.seconds), loop=0)
    return _embedded("gif", data)


def _embedded(kind: str, data: io.BytesIO) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data.getvalue()).decode()}"
