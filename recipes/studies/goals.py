"""``make goals``: which goals the studies hold and which they miss, read off the tables of ``docs/results``."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from onlinebayes.experiments import status
from onlinebayes.runs import write_atomic

HEAD = """# Goals

Goals that were judged, read off the tables by `make goals`. A goal is held or missed by the
value that the study's command printed. Misses of one quantity and goal share a line, with the
least and the largest value.
"""
PRESENT = """
## By commit
Tables that name the commit of the code that printed them.

| study | printed | commit | held | of |
|---|---|---|---|---|"""
MISSED = """| study | what | value | goal |
|---|---|---|---|"""
OLDER = """
## By older code
These tables were printed before tables named a commit. The code of today may hold or miss other goals.

| study | held | of |
|---|---|---|"""


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    results: Path = Path("docs/results")
    """folder of the tables, and of the page"""


def main(study: Study) -> None:
    """Write the page."""
    page = study.results / "goals.md"
    write_atomic(page, page_of(study.results))
    print(f"written: {page}")


def page_of(results: Path) -> str:
    """The page about the tables of a folder."""
    tables = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(results.glob("*.json"))]
    judged = [(table, rows) for table in tables if (rows := [row for row in table["rows"] if row["holds"] is not None])]
    present = [(table, rows) for table, rows in judged if table.get("commit")]
    older = [(table, rows) for table, rows in judged if not table.get("commit")]
    lines = [HEAD.rstrip("\n"), PRESENT]
    lines += [f"| {_linked(t)} | {t['date']} | {t['commit']} | {_held(rows)} | {len(rows)} |" for t, rows in present]
    lines += [f"| all | | | {_count(present)} |", OLDER]
    lines += [f"| {_linked(t)} | {_held(rows)} | {len(rows)} |" for t, rows in older]
    lines += [f"| all | {_count(older)} |"]
    for title, part in (("## Missed, by commit", present), ("## Missed, by older code", older)):
        lines += ["", title, MISSED, *(line for table, rows in part for line in _missed(table, rows))]
    return "\n".join(lines) + "\n"


def _linked(table: dict[str, Any]) -> str:
    return f"[{table['name']}]({table['name']}.md)"


def _count(judged: list[tuple[dict[str, Any], list[dict[str, Any]]]]) -> str:
    return f"{sum(_held(rows) for _, rows in judged)} | {sum(len(rows) for _, rows in judged)}"


def _held(rows: list[dict[str, Any]]) -> int:
    return sum(row["holds"] for row in rows)


def _missed(table: dict[str, Any], rows: list[dict[str, Any]]) -> Iterator[str]:
    """A line for each quantity and goal that rows of a table miss."""
    groups = dict[tuple[str, ...], list[dict[str, Any]]]()
    for row in rows:
        groups.setdefault((row["name"].rpartition(": ")[2], row["unit"], row["goal"] or ""), []).append(row)
    for (quantity, unit, goal), group in groups.items():
        values = [row["value"] for row in group if not row["holds"]]
        if values:
            names = [row["name"] for row in group if not row["holds"]]
            what = names[0] if len(names) == 1 else f"{quantity}: {len(names)} of {len(group)}"
            cells = (table["name"], what, f"{_range(values)} {unit}".strip(), goal)
            yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _range(values: list[Any]) -> str:
    """One value, several texts, or the least and the largest number."""
    texts = [value if isinstance(value, str) else f"{value:.4g}" for value in values]
    if len(values) == 1 or any(isinstance(value, str) for value in values):
        return ", ".join(dict.fromkeys(texts))
    return f"{min(values):.4g} to {max(values):.4g}"


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
