"""The blind study over the rigs of ``envs/rigs``: does refine name what is missing, and nothing where nothing is.

Every judged case is a file of its own, written at once: a study that was stopped goes on where it stopped. All kinds
and rigs advance together, so that the table of a part, which says of how many, is a sample of the whole.

    python -m recipes.studies.blind_rigs                               all cases -> docs/results/blind-rigs.json
    python -m recipes.studies.blind_rigs --pairs 5 --first 9100        two effects only -> docs/results/blind-pairs.json
    python -m recipes.studies.blind_rigs --rigs swing --effects 3 --null 1 --others 0 --first 0 --results /tmp/rigs
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from envs.rigs import KINDS, RIGS
from onlinebayes.experiments import STOPPED, status
from onlinebayes.runs import write_atomic
from recipes.studies.blind_rigs.judging import judge, unanswered
from recipes.studies.blind_rigs.plan import REPORTED, Job, jobs, pair_jobs
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.blind_rigs.table import tabulate
from recipes.studies.jobs import check_names, each_kept_or_done, print_rows, record


@dataclass(frozen=True)
class Study:
    """Options of the study; the numbers of cases are for each rig.

    Args:
        effects: cases that hide one or two effects.
        null: that hide nothing.
        others: of each of the other kinds.
        rigs: which.
        pairs: cases of two effects, and no others.
        first: seed of the first case; see :data:`REPORTED`.
        processes: that share the cases.
        minutes: of processor time after which refine gives the best answer so far. (The base fit and the study's own
            fits of the true effects come on top: a case is ended after four times that, and is a miss.)
        out: folder of the judged cases.
        results: folder of the table and of all judged cases in one file, ``NAME-cases.jsonl``.
    """

    effects: int = 4
    null: int = 1
    others: int = 1
    pairs: int = 0
    rigs: tuple[str, ...] = tuple(RIGS)
    first: int = REPORTED
    processes: int = 2
    minutes: float = 5.0
    out: Path = Path("out/blind_rigs")
    results: Path = Path("docs/results")

    @property
    def jobs(self) -> list[Job]:
        """Its cases, in their order."""
        if self.pairs:
            return pair_jobs(self.pairs, self.rigs, self.first)
        counts = {"effect": self.effects, "null": self.null}
        return jobs({kind: counts.get(kind, self.others) for kind in KINDS}, self.rigs, self.first)

    @property
    def name(self) -> str:
        """Of its table, and of the make target."""
        return "blind-pairs" if self.pairs else "blind-rigs"

    @property
    def cases(self) -> Path:
        """Folder of one file a case."""
        return self.out / "cases"


def main(study: Study) -> int:
    """Judge what is not judged yet, write the table of all that is and print it; returns the exit status."""
    check_names(study.rigs, RIGS)
    asked = {job: partial(judge, job, 60 * study.minutes) for job in study.jobs}
    limit = 4 * 60 * study.minutes
    found = each_kept_or_done(
        study.name, study.cases, asked, lambda job: job.name, processes=study.processes, limit=limit, failed=unanswered
    )
    answers = sorted((record(Judged, result) for result in found.values()), key=lambda judged: judged.name)
    table = tabulate(answers, len(asked), study.name)
    table.commit = found.commit
    print_rows(table)
    lines = "".join(json.dumps(asdict(judged)) + "\n" for judged in answers)
    write_atomic(study.results / f"{study.name}-cases.jsonl", lines)
    print(f"written: {table.write(study.results)}")
    return STOPPED if found.stopped else 0


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
