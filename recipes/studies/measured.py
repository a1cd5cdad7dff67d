"""``make measured``: every measured machine refined as a user would, against what is known of it.

    ONLINEBAYES_DATA=/path/to/data python -m recipes.studies.measured [--sets xl330 ...]  -> docs/results/measured.json

The sets are the modules of ``recipes.studies.measured_sets``; two run at a time, each command in a process of its own.
Held out are whole runs. Rows of sets that are not run stay as the file has them: all sets take an hour. A table of
which some rows are kept names no commit.
"""

from __future__ import annotations

import importlib
import json
import os
import pkgutil
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.experiments import status
from onlinebayes.runs import BadInput, ResultTable, Row
from recipes.studies import measured_sets
from recipes.studies.jobs import check_names, finished

PROCESSES = 2


def sets() -> tuple[str, ...]:
    """Names of all sets."""
    return tuple(module.name for module in pkgutil.iter_modules(measured_sets.__path__))


def judge(name: str, data: Path) -> tuple[Row, ...]:
    """The rows of one set."""
    return importlib.import_module(f"{measured_sets.__name__}.{name}").judge(data)


def table(names: Sequence[str], data: Path, known: Sequence[Row] = ()) -> ResultTable:
    """All rows, set by set: new ones of the sets named, of the others those that are known."""
    with ThreadPoolExecutor(PROCESSES) as pool:
        found = dict(zip(names, pool.map(lambda name: judge(name, data), names), strict=True))
    results = ResultTable("measured", "make measured", [0])
    if set(names) != set(sets()):
        results.commit = None  # of the rows that are kept nobody knows it
    for name in sets():
        results.rows += found.get(name, tuple(row for row in known if belongs(row, name)))
    return results


def belongs(row: Row, name: str) -> bool:
    """Check whether a row is one of this set's."""
    return row.name.startswith((f"{name}:", f"{name}/"))


def known_rows(file: Path) -> tuple[Row, ...]:
    """The rows of an earlier table; none without one."""
    if not file.exists():
        return ()
    return tuple(Row(**row) for row in json.loads(file.read_text(encoding="utf-8"))["rows"])


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    sets: tuple[str, ...] = sets()
    """which machines"""
    results: Path = Path("docs/results")
    """folder of the table"""


def main(study: Study) -> int:
    """Run the study and write its figures."""
    check_names(study.sets, sets())
    if not (data := os.environ.get("ONLINEBAYES_DATA")):
        raise BadInput("ONLINEBAYES_DATA is not set", "set it to the folder that holds the measured sets")
    return finished(table(study.sets, Path(data), known_rows(study.results / "measured.json")), study.results)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
