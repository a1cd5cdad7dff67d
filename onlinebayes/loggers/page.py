"""run.html: a run on one page that needs nothing but a browser.

Curves are drawn by matplotlib as SVG, pictures are PNG; all of it stands in the file itself.
"""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from onlinebayes.runs import write_atomic

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #22262d; max-width: 62rem; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.7rem; margin-bottom: 0 } h2 { font-size: 1.15rem; margin-top: 2rem }
p.lead { color: #5b626d; margin-top: .2rem }
table { border-collapse: collapse } td, th { padding: .25rem .9rem .25rem 0; text-align: right }
th { color: #5b626d; font-weight: 500; border-bottom: 1px solid #d5d9df }
td:first-child, th:first-child { text-align: left }
img, svg { max-width: 100%; height: auto } .row { display: flex; flex-wrap: wrap; gap: 1rem; align-items: flex-start }
.bar { display: flex; height: 1.3rem; border-radius: 3px; overflow: hidden } .bar span { display: block }
ul.notes { color: #5b626d; font-size: .92rem; padding-left: 1.2rem }
"""
COLOURS = ("#2a6f97", "#d1495b", "#8a8f98", "#e9a23b", "#4c956c", "#7a5195")


@dataclass(frozen=True)
class Curves:
    """A chart: some lines over one x.

    Args:
        title: above it.
        x: name and values.
        lines: name -> values; what is nan is left out.
        bands: name of a line -> low and high around it.
        levels: name -> height of a dashed line.
    """

    title: str
    x: tuple[str, Sequence[float]]
    lines: Mapping[str, Sequence[float]]
    bands: Mapping[str, tuple[Sequence[float], Sequence[float]]]
    levels: Mapping[str, float]


@dataclass(frozen=True)
class Page:
    """What the page shows.

    Args:
        title: of the run.
        lead: one line below it.
        head: of the table of parameters.
        rows: of it.
        charts: in order.
        pictures: caption -> pixels (H, W, 3).
        seconds: part -> seconds in all.
        notes: one line each.
    """

    title: str
    lead: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    charts: Sequence[Curves]
    pictures: Mapping[str, np.ndarray]
    seconds: Mapping[str, float]
    notes: Sequence[str]


def write_page(page: Page, path: str | Path) -> None:
    """Write the page, atomically."""
    write_atomic(path, to_html(page))


def to_html(page: Page) -> str:
    """The page as text."""
    parts = [f"<h1>{html.escape(page.title)}</h1>", f'<p class="lead">{html.escape(page.lead)}</p>']
    parts += [_table(page.head, page.rows)]
    parts += ['<div class="row">', *(_chart(chart) for chart in page.charts), "</div>"]
    for caption, pixels in page.pictures.items():
        parts += [f"<h2>{html.escape(caption)}</h2>", f'<img alt="{html.escape(caption)}" src="{_png(pixels)}">']
    if page.seconds:
        parts += ["<h2>Where the time went</h2>", _bar(page.seconds)]
    if page.notes:
        notes = "".join(f"<li>{html.escape(note)}</li>" for note in page.notes)
        parts += ["<h2>What was decided, and what went wrong</h2>", f'<ul class="notes">{notes}</ul>']
    head = f'<meta charset="utf-8"><title>{html.escape(page.title)}</title><style>{STYLE}</style>'
    return f"<!doctype html><html lang=en><head>{head}</head><body>{''.join(parts)}</body></html>\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    cells = "".join(f"<th>{html.escape(cell)}</th>" for cell in head)
    lines = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{lines}</table>"


def _bar(seconds: Mapping[str, float]) -> str:
    total = sum(seconds.values()) or 1.0
    pieces, words = [], []
    for i, (name, value) in enumerate(seconds.items()):
        colour = COLOURS[i % len(COLOURS)]
        pieces.append(f'<span style="width:{100 * value / total:.2f}%;background:{colour}"></span>')
        words.append(f'<span style="color:{colour}">■</span> {html.escape(name)} {value:.1f} s')
    return f'<div class="bar">{"".join(pieces)}</div><p>{" &nbsp; ".join(words)}</p>'


def _chart(chart: Curves) -> str:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    figure = Figure(figsize=(4.6, 2.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for i, (name, values) in enumerate(chart.lines.items()):
        colour = COLOURS[i % len(COLOURS)]
        axes.plot(chart.x[1], values, "o-", markersize=3, color=colour, label=name)
        if name in chart.bands:
            axes.fill_between(chart.x[1], *chart.bands[name], color=colour, alpha=0.2, linewidth=0)
    for name, level in chart.levels.items():
        axes.axhline(level, color=COLOURS[1], linestyle="--", linewidth=1, label=name)
    axes.set_title(chart.title, fontsize=10)
    axes.set_xlabel(chart.x[0], fontsize=9)
    axes.tick_params(labelsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    axes.spines[["top", "right"]].set_visible(False)
    if len(chart.lines) + len(chart.levels) > 1:
        axes.legend(fontsize=8, frameon=False)
    text = io.StringIO()
    figure.savefig(text, format="svg")
    return text.getvalue()[text.getvalue().index("<svg") :]


def _png(pixels: np.ndarray) -> str:
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(pixels).save(data, format="PNG", optimize=True)
    return "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
