"""``make goals``: which goals the studies hold and which they miss, read off the tables of ``docs/results``."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from onlinebayes.runs import write_atomic
from recipes.command import status

HEAD = """# Goals

Goals that were judged, read off the tables by `make goals`. A goal is held or missed by the
value that the study's command printed.
"""


@dataclass(frozen=True)
class Study:
    """What to read."""

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
    judged = [(table["name"], [row for row in table["rows"] if row["holds"] is not None]) for table in tables]
    judged = [(name, rows) for name, rows in judged if rows]
    held, total = (sum(f(rows) for _, rows in judged) for f in (_held, len))
    lines = [HEAD, "| study | held | of |", "|---|---|---|"]
    lines += [f"| [{name}]({name}.md) | {_held(rows)} | {len(rows)} |" for name, rows in judged]
    lines += [f"| all | {held} | {total} |", "", "## Missed"]
    for name, rows in judged:
        if _held(rows) < len(rows):
            lines += ["", f"### {name}", "| what | value | goal |", "|---|---|---|", *_missed(rows)]
    return "\n".join(lines) + "\n"


def _held(rows: list[dict[str, Any]]) -> int:
    return sum(row["holds"] for row in rows)


def _missed(rows: list[dict[str, Any]]) -> Iterator[str]:
    for row in rows:
        if not row["holds"]:
            value = row["value"] if isinstance(row["value"], str) else f"{row['value']:.4g}"
            cells = (row["name"], f"{value} {row['unit']}".strip(), row["goal"] or "")
            yield "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
