"""``docs/thesis.md``: its figures and tables, written from the result files and checked against them.

    [5.30](results/exact.md "the row's name")       a figure: the value of that row of results/exact.json, as rounded
    <!-- table 4.1 --> ... <!-- end -->             one of :data:`TABLES`, written anew by :func:`filled`

A cell of Tables 4.1 and 5.1 holds our median, and without noise the thesis's figure of the same method in brackets.
"""

from __future__ import annotations

import json
import re
import statistics
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from recipes.studies.thesis.columns import CEILING, COLUMNS, FILTER, TEN_AS_ONE
from recipes.studies.thesis.printed import FOURIER, LOOP, NETWORK, REJECTION, TABLE_4_1, TABLE_5_1, TABLE_5_2

FIGURE = re.compile(r'\[([^\]]+)\]\(results/([\w.-]+)\.md "([^"]+)"\)')
BLOCK = re.compile(r"(<!-- table ([\w.-]+) -->\n).*?(<!-- end -->)", re.DOTALL)
NUMBER = re.compile(r"-?\d*\.?\d+")
MISSING = "-"

Rows = Mapping[str, Mapping[str, Any]]
"""Row's name -> row of a result file."""

HEADS = {
    "4.1": [*COLUMNS, TEN_AS_ONE, FILTER, CEILING],
    "5.1": [*COLUMNS, FILTER, CEILING, LOOP],
}
THESIS = {"4.1": TABLE_4_1, "5.1": TABLE_5_1}


def rows_of(results: Path, name: str) -> Rows:
    """The rows of a result file; none where there is no file."""
    file = results / f"{name}.json"
    return {row["name"]: row for row in json.loads(file.read_text(encoding="utf-8"))["rows"]} if file.exists() else {}


def wrong(text: str, results: Path) -> list[str]:
    """One line for each figure of a page that is not what its result file holds.

    Args:
        text: of the page.
        results: folder of the result files.
    """
    return [problem for told, name, row in FIGURE.findall(text) if (problem := _problem(told, name, row, results))]


def _problem(told: str, name: str, row: str, results: Path) -> str | None:
    rows = rows_of(results, name)
    if row not in rows:
        return f"{name} has no row '{row}'"
    value, number = rows[row]["value"], NUMBER.fullmatch(told)
    if isinstance(value, str):
        return None if told == value else f"{name}, {row}: {told} is told, '{value}' stands there"
    if number is None:
        return f"{name}, {row}: '{told}' is no number"
    digits = len(told.partition(".")[2])
    return None if round(value, digits) == float(told) else f"{name}, {row}: {told} is told, {value:g} stands there"


def filled(text: str, results: Path) -> str:
    """The page with its tables and figures as the result files have them, figures with as many digits as before."""

    def block(found: re.Match[str]) -> str:
        return found[1] + "\n".join(TABLES[found[2]](results)) + "\n" + found[3]

    def figure(found: re.Match[str]) -> str:
        told, name, row = found.groups()
        if row not in (rows := rows_of(results, name)):
            return found[0]
        value, digits = rows[row]["value"], len(told.partition(".")[2])
        return f'[{value if isinstance(value, str) else f"{value:.{digits}f}"}](results/{name}.md "{row}")'

    return FIGURE.sub(figure, BLOCK.sub(block, text))


def densities(number: str, results: Path) -> Iterator[str]:
    """Table 4.1 or 5.1: two lines a system, without noise and with."""
    heads, rows = HEADS[number], rows_of(results, f"thesis-{number}")
    if not rows:
        yield "**Missing**: `make thesis` was not run to its end yet."
        return
    yield from _head(["system", "prior", "noise", *heads])
    for told, thesis in THESIS[number].items():
        for noise in ("0", "1"):
            head = f"{told}, noise {noise} %"
            if any(f"{head}: {column}" in rows for column in heads):
                cells = [_cell(rows.get(f"{head}: {column}"), thesis.get(column), noise) for column in heads]
                yield _line([told, _text(rows[f"{told}: the prior"]["value"]), f"{noise} %", *cells])


OLDER = {
    "rejection": (REJECTION, REJECTION),
    "mixture": ("network", NETWORK),
    "Fourier features": (FOURIER, FOURIER),
    "filter": (FILTER, FILTER),
}
"""Column of ``make tables`` -> its head, the thesis's column."""


def five_seeds(results: Path) -> Iterator[str]:
    """The columns of ``make tables``: medians, standard deviations, and where random features beat the network."""
    rows, below, wider = rows_of(results, "tables"), 0, 0
    yield from _head(["parameter", "prior", *(word for head, _ in OLDER.values() for word in (head, "sd"))])
    for told, thesis in TABLE_4_1.items():
        if f"{told}, mixture" not in rows:
            continue
        found, spread, cells = {}, {}, []
        for name, (_, column) in OLDER.items():
            row = rows.get(f"{told}, {name}")
            cells += [_cell(row, thesis.get(column), "0"), MISSING]
            if row is not None:
                found[name], spread[name] = row["value"], statistics.stdev(map(float, row["spread"].split()))
                cells[-1] = _text(spread[name])
        below += found["Fourier features"] < found["mixture"]
        wider += spread["Fourier features"] > spread["mixture"]
        yield _line([told, _text(rows[f"{told}: the prior"]["value"]), *cells])
    number = sum(name.endswith(", mixture") for name in rows)
    yield ""
    yield f"Fourier features are below the network in {below} of {number} rows, and spread wider in {wider}."


def online(results: Path) -> Iterator[str]:
    """The rows of ``make table-online``."""
    rows = rows_of(results, "table-online")
    columns = {"noise 0 %: ours": "ours, no noise", "noise 1 %: ours": "ours, 1 % noise"}
    columns["noise 1 %: exact posterior"] = "exact posterior, 1 % noise"
    yield from _head(["system", "prior", "Online BayesSim", *columns.values()])
    for told, thesis in TABLE_5_1.items():
        if f"{told}: the prior" in rows:
            cells = [_cell(rows.get(f"{told}, {column}"), None, "0") for column in columns]
            yield _line([told, _text(rows[f"{told}: the prior"]["value"]), _text(thesis[LOOP]), *cells])


def circle(results: Path) -> Iterator[str]:
    """Table 5.2, by the rows of ``make skid-steer``: each side on which the robot may turn, and the truth's cost."""
    rows, plans = rows_of(results, "skid-steer"), ": cost by plans for the "
    if not rows:
        yield "**Missing**: `make skid-steer` is not printed yet."
        return
    sides = list(dict.fromkeys(name.split(plans)[0] for name in rows if plans in name))
    yield from _head(["plans for", "thesis", *sides])
    for name in (*TABLE_5_2, "truth"):
        costs = [rows.get(f"{side}{plans}{name}") for side in sides]
        cells = [MISSING if cost is None else f"{cost['value']:.3g}" for cost in costs]
        yield _line([name, TABLE_5_2.get(name, MISSING), *cells])


GAITS = {"Table 4.1": ("3.391", "[0.3, 0.5]", "MuJoCo"), "Table 5.1": ("3.384", "[0.1, 0.5]", "Drake")}
"""Table -> the thesis's best density of the hopper's friction, its prior here, the engine that is measured."""
FETCH = {
    "Table 4.1, Fetch Push": ("2.423", "push, protocol, U[0.1, 1.0]"),
    "Table 4.1, Fetch Slide": ("2.391", "slide, protocol of Table 4.1, U[0.1, 1.0]"),
    "Table 5.1, Fetch Push": ("2.18", "push, protocol of Table 5.1, U[0.1, 2.0]"),
    "Table 5.1, Fetch Slide": ("3.24", "slide, protocol, U[0.1, 2.0]"),
}
"""Row -> the thesis's best, the case of ``make fetch-friction`` with its prior."""


def friction(results: Path) -> Iterator[str]:
    """The Fetch arm's and the hopper's rows of both tables."""
    arm, legs = rows_of(results, "fetch-friction"), rows_of(results, "hopper")
    if not arm or not legs:
        yield "**Missing**: `make fetch-friction` or `make hopper` is not printed yet."
        return
    yield from _head(["row", "friction", "thesis's best", "ours", "prior", "ceiling"])
    for told, (thesis, case) in FETCH.items():
        names = (f"{case}: log density", f"{case}: the prior")
        yield _line([told, case[case.index("U[") :], thesis, *(_text(arm[name]["value"]) for name in names), MISSING])
    for told, (thesis, prior, engine) in GAITS.items():
        case = f"prior U{prior}, running, measured in"
        rows = (f"{case} {engine}: log density of the truth", f"prior U{prior}: the prior's density")
        shown = [_text(legs[name]["value"]) for name in (*rows, f"{case} MuJoCo: exact, its start known")]
        row = f"{told}, Hopper, measured in {engine}"
        yield _line([row, f"U{prior}", thesis, *shown])


USES = {"0": "0.077", "0.1": "0.18", "0.2": "0.6", "0.3": "0.88"}
"""lambda of a published policy -> its use of the camera."""


def recorded(results: Path) -> Iterator[str]:
    """The published policies of chapter 3 beside ours, by the rows of ``make egocentric``."""
    rows = rows_of(results, "egocentric")
    if not rows:
        yield "**Missing**: `make egocentric` is not printed yet."
        return
    yield from _head(["lambda", "published policy", "its use of the camera", "ours, by row", "by block", "random mix"])
    for told, use in USES.items():
        names = [f"recorded rows{fold} at use {use}" for fold in (", by row: accuracy", ", by block: accuracy")]
        names = [f"published policy, lambda {told}: accuracy", *names, f"recorded rows: random mix at use {use}"]
        published, *ours = (f"{rows[name]['value']:.3f}" for name in names)
        yield _line([told, published, use, *ours])


def pipeline(results: Path) -> Iterator[str]:
    """The actor-critic of chapter 3 in our own pipeline, by the rows of ``make egocentric``."""
    rows, above = rows_of(results, "egocentric"), ": actor-critic above the random mix at use "
    yield from _head(["use of the camera", "by sequence", "leaky split, as published", "by sequence, less reference"])
    for use in [name.split(above)[1] for name in rows if name.startswith(f"by sequence{above}")]:
        less = f"by sequence: actor-critic less reference at use {use}"
        names = [f"by sequence{above}{use}", f"leaky{above}{use}", less]
        yield _line([use, *(f"{rows[name]['value']:.1f}" for name in names)])


TABLES: dict[str, Callable[[Path], Iterable[str]]] = {
    "4.1": partial(densities, "4.1"),
    "5.1": partial(densities, "5.1"),
    "five-seeds": five_seeds,
    "online": online,
    "5.2": circle,
    "friction": friction,
    "recorded": recorded,
    "pipeline": pipeline,
}


def _head(cells: Sequence[str]) -> list[str]:
    return [_line(cells), _line(["---"] * len(cells))]


def _cell(row: Mapping[str, Any] | None, thesis: float | None, noise: str) -> str:
    ours = MISSING if row is None else _text(row["value"])
    return f"{ours} ({_text(thesis)})" if thesis is not None and noise == "0" else ours


def _text(value: float) -> str:
    text = f"{value:.2f}"
    return "0.00" if text == "-0.00" else text


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
