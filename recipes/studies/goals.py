"""``make goals``: which goals the studies hold and which they miss, read off the tables of ``docs/results``."""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from onlinebayes.experiments import status
from onlinebayes.runs import write_atomic

HEAD = """# Goals

Goals that were judged, read off the tables by `make goals`: how many are held, and the quantities in which the others
are missed. Values and goals stand on each study's page. A table without a commit was printed before tables named one:
the code of today may hold or miss other goals.

| study | printed | commit | held | of | missed |
|---|---|---|---|---|---|"""


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
    """The page about the tables of a folder, those with a commit first."""
    tables = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(results.glob("*.json"))]
    judged = [(table, rows) for table in tables if (rows := [row for row in table["rows"] if row["holds"] is not None])]
    judged.sort(key=lambda pair: not pair[0].get("commit"))
    lines = [HEAD, *(_line(table, rows) for table, rows in judged)]
    held, all_of_them = (sum(count(rows) for _, rows in judged) for count in (_held, len))
    return "\n".join([*lines, f"| all | | | {held} | {all_of_them} | |"]) + "\n"


def _line(table: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> str:
    name, missed = table["name"], "; ".join(_missed(rows)).replace("|", "\\|")
    cells = (f"[{name}]({name}.md)", table.get("date") or "", table.get("commit") or "", _held(rows), len(rows), missed)
    return "| " + " | ".join(map(str, cells)) + " |"


def _held(rows: Sequence[Mapping[str, Any]]) -> int:
    return sum(row["holds"] for row in rows)


def _missed(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The quantities that miss a goal, and how often where it is more than once."""
    counts = Counter(row["name"].rpartition(": ")[2] for row in rows if not row["holds"])
    for quantity, count in counts.items():
        yield quantity if count == 1 else f"{quantity} ({count})"


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
