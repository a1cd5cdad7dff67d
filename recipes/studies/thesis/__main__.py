"""``make thesis``: Tables 4.1 and 5.1 of the thesis with our columns beside its own, and the page that shows them.

Every system, without sensor noise and with 1 %; with noise the ceiling stands beside each density, the exact posterior
or whoever knows the start exactly. The rows of the Fetch arm and of the hopper are those of ``make fetch-friction`` and
``make hopper``. Each finished job is kept.

    python -m recipes.studies.thesis [--parts 4.1] [--noises 0] [--systems CartPole]     -> docs/results/thesis-4.1.json
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from onlinebayes.experiments import status
from onlinebayes.runs import write_atomic
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by
from recipes.studies.table_online import ROWS
from recipes.studies.table_systems import SYSTEMS
from recipes.studies.thesis import page, table_4_1, table_5_1
from recipes.studies.thesis.rows import Job, Part, tables


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    parts: tuple[Part, ...] = ("4.1", "5.1", "loop")
    """Table 4.1, Table 5.1, and its runs of the thesis's own learner"""
    systems: tuple[str, ...] = (*SYSTEMS, *ROWS)
    """rows of either table"""
    noises: tuple[float, ...] = (0.0, 0.01)
    """of the sensors, as a share of each range"""
    seeds: tuple[int, ...] = (2, 3)
    """of truths, simulations and networks"""
    page: Path = Path("docs/thesis.md")
    """whose tables are written anew"""
    only_page: bool = False
    """the page's tables from the result files that there are, and which of its figures are wrong"""
    out: str = "out/thesis"


DO: dict[Part, tuple[Callable[[str, float, int], dict[str, Any]], tuple[str, ...]]] = {
    "4.1": (table_4_1.judged, tuple(SYSTEMS)),
    "5.1": (table_5_1.judged, tuple(ROWS)),
    "loop": (table_5_1.in_the_loop, tuple(ROWS)),
}


def main(study: Study) -> int:
    """Do what is missing, print the tables."""
    if study.only_page:
        return written(study)
    jobs: dict[Job, Callable[[], dict[str, Any]]] = {}
    for seed in study.seeds:
        for noise in study.noises:
            for part in study.parts:
                do, names = DO[part]
                some = [name for name in names if name in study.systems]
                jobs |= {(part, name, noise, seed): partial(do, name, noise, seed) for name in some}
    found = each_kept_or_done("thesis", study.out, jobs, file_of, study.ray_workers)
    missed = [
        finished(table, study.results, found)
        for table in tables(found, printed_by("thesis", study), sorted({job[-1] for job in found}))
    ]
    return max([*missed, written(study)])


def written(study: Study) -> int:
    """Write the page's tables anew, and say which of its figures their result files do not hold."""
    text = page.filled(study.page.read_text(encoding="utf-8"), study.results)
    write_atomic(study.page, text)
    print("\n".join([f"written: {study.page}", *(problems := page.wrong(text, study.results))]))
    return 1 if problems else 0


def file_of(job: Job) -> str:
    """Name of a job's file."""
    return "-".join(map(str, job)).replace(", ", "-").replace(" ", "_")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
