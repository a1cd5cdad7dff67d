"""Result tables: ``docs/results/NAME.json`` and the Markdown page made from it.

Each row is ``{name, value, spread, unit, goal, holds}``; the head records command, date, commit, seeds, versions and
machine, so that every figure in a document can be printed again, by the code that printed it.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import platform
import statistics
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from onlinebayes.runs.files import write_atomic
from onlinebayes.runs.results_page import full_table, result_page
from onlinebayes.runs.revision import commit

PACKAGES = (
    "onlinebayes",
    "torch",
    "tensordict",
    "torchrl",
    "mujoco",
    "mujoco-core",  # the bindings, from MuJoCo 4 on
    "gymnasium",
    "numpy",
    "scipy",
    "pysindy",
    "sbi",
)


@dataclass(frozen=True)
class Row:
    """One figure: its name, value, spread, unit, the goal in words and whether it holds (None: no goal)."""

    name: str
    value: float | str
    spread: float | str | None = None
    unit: str = ""
    goal: str | None = None
    holds: bool | None = None


@dataclass
class ResultTable:
    """Rows with a head, written as JSON and as Markdown.

    Args:
        name: the make target's name; also the file's.
        command: what a reader types to get the same figures.
        seeds: the seeds that were run.
        commit: of the code that did the work, "+" where it was changed since; None where nobody knows. A study that
            prints work kept from earlier names the commits that did it.
    """

    name: str
    command: str
    seeds: Sequence[int]
    rows: list[Row] = field(default_factory=list)
    commit: str | None = field(default_factory=commit)

    def add(
        self,
        name: str,
        value: float | str,
        *,
        spread: float | str | None = None,
        unit: str = "",
        goal: str | None = None,
        holds: bool | None = None,
    ) -> None:
        """Append one row; ``holds`` is computed by the caller from the unrounded value."""
        self.rows.append(Row(name, value, spread, unit, goal, holds))

    def add_seeds(
        self,
        name: str,
        values: Sequence[float],
        *,
        unit: str = "",
        least: float | None = None,
        most: float | None = None,
    ) -> None:
        """Append the median over the seeds, with every value; the median is to be at least or at most so much."""
        median = statistics.median(values)
        goal, holds = None, None
        if least is not None:
            goal, holds = f">= {least:g}", median >= least
        elif most is not None:
            goal, holds = f"<= {most:g}", median <= most
        each = " ".join(f"{value:.4g}" for value in values)
        self.add(name, median, spread=each, unit=unit, goal=goal, holds=holds)

    @property
    def holds(self) -> bool:
        """True if no row misses its goal."""
        return all(row.holds is not False for row in self.rows)

    def to_json(self) -> str:
        """The table with its head; numbers that JSON lacks (inf, nan) become text."""
        head = {
            "name": self.name,
            "command": self.command,
            "date": today(),
            "commit": self.commit,
            "seeds": list(self.seeds),
            "versions": versions(),
            "machine": machine(),
        }
        rows = [{key: _finite(value) for key, value in asdict(row).items()} for row in self.rows]
        return json.dumps({**head, "rows": rows}, indent=1) + "\n"

    def to_markdown(self) -> str:
        """The head and every row."""
        return full_table(json.loads(self.to_json()))

    def write(self, folder: str | Path = "docs/results") -> Path:
        """Write ``NAME.json`` and its page ``NAME.md`` atomically and return the JSON's path."""
        folder, table = Path(folder), self.to_json()
        write_atomic(folder / f"{self.name}.md", result_page(json.loads(table)))
        write_atomic(folder / f"{self.name}.json", table)
        return folder / f"{self.name}.json"


def today() -> str:
    """The date of printing, YYYY-MM-DD in UTC."""
    return datetime.now(UTC).date().isoformat()


def versions() -> dict[str, str]:
    """The versions of Python and of the packages that decide a figure."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def machine() -> str:
    """The machine in words: processor family and the number of cores this process may use."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return f"{platform.system()} {platform.machine()}, {cores} cores"


def _finite(value: object) -> object:
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
