"""The blind study over the rigs of ``envs/rigs``: does refine name what is missing, and nothing where nothing is.

Every judged case is a file of its own, written at once: a study that was stopped goes on where it stopped. All kinds
and rigs advance together, so that the table of a part, which says of how many, is a sample of the whole.

    python -m recipes.studies.blind_rigs                               all cases -> docs/results/blind-rigs.json
    python -m recipes.studies.blind_rigs --published docs/results/blind-rigs-cases.jsonl      those not judged yet
    python -m recipes.studies.blind_rigs --pairs 5 --first 9100        two effects only -> docs/results/blind-pairs.json
    python -m recipes.studies.blind_rigs --rigs swing --effects 3 --null 1 --others 0 --first 0 --results /tmp/rigs
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import envs.rigs
import onlinebayes
from envs.rigs import KINDS, RIGS
from onlinebayes.experiments import STOPPED, status
from onlinebayes.runs import BadInput, Progress, write_atomic
from recipes.studies.blind_rigs.judging import Judge, unanswered
from recipes.studies.blind_rigs.plan import REPORTED, in_words, jobs, pair_jobs, seconds_to_go
from recipes.studies.blind_rigs.record import Judged, from_json
from recipes.studies.blind_rigs.table import tabulate
from recipes.studies.blind_rigs.workers import Done, work
from recipes.studies.job import Job
from recipes.studies.json_line import line
from recipes.studies.resumable import check_names, code_mark, commit_of, kept, print_rows


@dataclass(frozen=True)
class Study:
    """What to run; the numbers of cases are for each rig.

    Args:
        effects: cases that hide one or two effects.
        null: that hide nothing.
        others: of each of the other kinds.
        rigs: which.
        pairs: cases of two effects, and no others.
        first: seed of the first case; see :data:`REPORTED`.
        candidates: effects that refine tries; none for all.
        processes: that share the cases.
        minutes: of processor time that refine may take for a case; one that takes longer is a miss. (The study's own
            fits of the true effects come on top, and beside other work a case takes longer: it is ended after four
            times that.)
        out: folder of the judged cases.
        results: folder of the table and of all judged cases in one file, ``NAME-cases.jsonl``.
        published: such a file, of a part of the study that was judged elsewhere; its cases are not judged again.
    """

    effects: int = 4
    null: int = 1
    others: int = 1
    pairs: int = 0
    rigs: tuple[str, ...] = tuple(RIGS)
    first: int = REPORTED
    candidates: tuple[str, ...] = ()
    processes: int = 2
    minutes: float = 10.0
    out: Path = Path("out/blind_rigs")
    results: Path = Path("docs/results")
    published: Path | None = None

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
    if study.processes < 1:
        raise BadInput(f"{study.processes} processes cannot judge anything", "use one or more")
    wanted, code = study.jobs, code_mark((onlinebayes, envs.rigs), *study.candidates)
    before = kept(study.cases, (job.name for job in wanted), from_json)
    found = {**read_published(study.published, wanted), **before}
    todo = [job for job in wanted if job.name not in found]
    print(f"{len(wanted)} cases, {len(found)} of them judged before (in {study.cases})", file=sys.stderr)
    if old := sum(judged.code != code for judged in found.values()):
        print(f"{old} of them by other code or with other candidates: remove their files to go anew", file=sys.stderr)
    stopped = False
    try:
        judge_all(study, todo, found, code)
    except KeyboardInterrupt:
        print(f"stopped; {len(found)} of {len(wanted)} cases are kept; the same command goes on", file=sys.stderr)
        stopped = True
    table = tabulate(list(found.values()), len(wanted), study.name)
    table.commit = commit_of((judged.code for judged in found.values()), code)
    print_rows(table)
    ordered = sorted(found.values(), key=lambda judged: judged.name)
    write_atomic(study.results / f"{study.name}-cases.jsonl", "".join(map(line, ordered)))
    print(f"written: {table.write(study.results)}")
    return STOPPED if stopped else 0


def judge_all(study: Study, todo: list[Job], found: dict[str, Judged], code: str) -> None:
    """Judge the cases, each kept as soon as it is known; ``found`` grows."""
    left, fresh = {job.name: job for job in todo}, []
    with Progress("blind rigs", len(todo) + len(found)) as progress:
        for done in work(todo, Judge(study.candidates, code), study.processes, 4 * 60 * study.minutes):
            judged = _answered(done, code, 60 * study.minutes)
            write_atomic(study.cases / f"{judged.name}.json", line(judged))
            found[judged.name] = judged
            fresh.append(judged)
            del left[judged.name]
            progress.update(len(found), _line(judged, fresh, left.values(), study.processes))


def read_published(file: Path | None, wanted: Iterable[Job]) -> dict[str, Judged]:
    """The wanted cases of a published file, by name.

    Raises:
        BadInput: it is no such file.
    """
    if file is None:
        return {}
    try:
        judged = [from_json(text) for text in file.read_text(encoding="utf-8").splitlines()]
    except (OSError, ValueError, TypeError) as error:
        raise BadInput(f"{file} holds no judged cases: {error}", "name a blind-rigs-cases.jsonl") from None
    names = {job.name for job in wanted}
    return {one.name: one for one in judged if one.name in names}


def _answered(done: Done[Job, Judged], code: str, most: float) -> Judged:
    """The record of a case; ``most``: seconds of processor time that refine may take."""
    if done.result is not None and done.result.seconds <= most:
        return done.result
    seconds = done.seconds if done.result is None else done.result.seconds
    return unanswered(done.job, done.problem or "out of time", seconds, code)


def _line(judged: Judged, fresh: list[Judged], left: Iterable[Job], processes: int) -> str:
    told = judged.ended or f"{judged.verdict}, {', '.join(judged.accepted) or 'nothing'}"
    # The first few are the quick ones, and say little about the others.
    rest = f"; about {in_words(seconds_to_go(fresh, left, processes))} to go" if len(fresh) >= 4 * processes else ""
    return f"{judged.name}: {told}{' (MISS)' if judged.missed else ''}{rest}"


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
