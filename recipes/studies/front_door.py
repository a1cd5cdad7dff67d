"""``make front-door``: are logs read as people write them, in time, and can the answer be taken home?

| row                          | what is asked                                                                    |
|------------------------------|----------------------------------------------------------------------------------|
| conventions matched ..       | every name of the model that the log has gets its column (:mod:`.conventions`)   |
| case FOLDER: COMMAND         | a log as somebody gave it gives what is right for it (:mod:`.front_door_cases`)  |
| .., processor time           | large inputs (:mod:`.front_door_times`)                                          |
| export to TARGET             | what ``refine`` found is written and loads back (:mod:`.front_door_exports`)     |

    python -m recipes.studies.front_door        -> docs/results/front-door.json

Some 10 minutes on two cores; without the folder of cases their rows are left out, with a line.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.experiments import status
from onlinebayes.runs import ResultTable
from recipes.studies.conventions import CONVENTIONS
from recipes.studies.front_door_cases import CASES, answer
from recipes.studies.front_door_exports import every_target, refined
from recipes.studies.front_door_times import many_joints, many_rows, spent

FEWEST = 29
JOINTS_S, ROWS_S, ROWS_GB, SLOW_S = 20.0, 60.0, 2.0, 60.0
"""Goals: processor time of ``init`` with 60 joints, of ``compare`` of a million rows and of slow cases [s]; memory."""
SLOW = {"xarm7_gripper_slow": "few.toml", "ur5e_payload_friction": "p.toml"}
STOPPED = 130
LIMIT_S = 90.0
"""Processor time after which a command is asked to stop [s]."""


@dataclass(frozen=True)
class Study:
    """Options of the study.

    Args:
        results: folder of the table.
        cases: folder of the cases; by default ``cases/front-door`` beside the folder in ONLINEBAYES_DATA.
    """

    results: Path = Path("docs/results")
    cases: str = ""

    @property
    def folder(self) -> Path | None:
        """The folder of the cases; None where it is not there."""
        data = os.environ.get("ONLINEBAYES_DATA")
        folder = Path(self.cases) if self.cases else Path(data or ".").resolve().parent / "cases" / "front-door"
        return folder.resolve() if (self.cases or data) and folder.is_dir() else None


def names(table: ResultTable) -> None:
    """Rows of the conventions of names."""
    verdicts = {one.who: one.verdict for one in CONVENTIONS}
    count = Counter(verdicts.values())
    every = f"of {len(CONVENTIONS)}"
    rightly, wrongly = count["rightly"], count["wrongly"]
    table.add("conventions matched rightly", rightly, unit=every, goal=f">= {FEWEST}", holds=rightly >= FEWEST)
    for verdict in ("in part", "not at all"):
        who = [one for one, found in verdicts.items() if found == verdict]
        table.add(f"conventions matched {verdict}", count[verdict], spread="; ".join(who) or None, unit=every)
    who = [one for one, found in verdicts.items() if found == "wrongly"]
    table.add("conventions matched wrongly", wrongly, spread="; ".join(who) or None, goal="0", holds=wrongly == 0)


def cases(table: ResultTable, folder: Path, out: Path) -> None:
    """Rows of the logs and models that people gave."""
    for case in CASES:
        found = answer(case, folder, out)
        right = not found.lacking and found.status == case.status
        said = "right" if right else f"status {found.status}; not said: {'; '.join(found.lacking)}"
        table.add(f"case {case.folder}: {case.words}", said, unit=f"{found.seconds:.1f} s", goal="right", holds=right)
        print(table.rows[-1], file=sys.stderr)


def times(table: ResultTable, folder: Path | None, out: Path) -> None:
    """Rows of large inputs."""
    asked = [
        ("init, 60 joints", many_joints(out / "joints"), JOINTS_S),
        ("compare, a million rows", many_rows(out / "rows"), ROWS_S),
    ]
    if folder is not None:
        for name, problem in SLOW.items():
            words = ["compare", str(folder / name / problem), "--out", str(out / name)]
            asked.append((f"case {name}: compare {problem}", words, SLOW_S))
    for name, words, most in asked:
        cost = spent(words, LIMIT_S)
        more = (
            ""
            if cost.status == 0
            else f"stopped at {LIMIT_S:g} s"
            if cost.status == STOPPED
            else f"status {cost.status}"
        )
        holds = cost.status == 0 and cost.processor <= most
        goal = f"<= {most:g}"
        table.add(f"{name}, processor time", round(cost.processor, 1), spread=more, unit="s", goal=goal, holds=holds)
        if "rows" in name:
            memory = round(cost.memory, 2)
            table.add(f"{name}, memory", memory, unit="GB", goal=f"<= {ROWS_GB:g}", holds=memory <= ROWS_GB)
        print(table.rows[-1], file=sys.stderr)


def exports(table: ResultTable, out: Path) -> None:
    """Rows of the places where people train."""
    for target, found in every_target(refined(out / "pendulum"), out / "exports").items():
        table.add(f"export to {target}", found or "not loaded back", goal="loaded back", holds=bool(found))


def main(study: Study) -> int:
    """Print and write the table; returns 1 where a goal is missed."""
    table = ResultTable("front-door", "make front-door", seeds=())
    folder = study.folder
    names(table)
    with tempfile.TemporaryDirectory() as made:
        out = Path(made)
        if folder is None:
            print("front-door: the cases are left out: give --cases, or ONLINEBAYES_DATA beside them", file=sys.stderr)
        else:
            cases(table, folder, out)
        exports(table, out)
        times(table, folder, out)
    table.write(study.results)
    print(table.to_markdown())
    return int(not table.holds)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
