"""``make exclusion-limits``: is an effect of 1.5 times the exclusion limit found.

For each of the eight rigs some records with nothing hidden; into each, one by one, effects of 1.5 times the limit that
refine gives there. Every record is a file of its own, written at once: a study that was stopped goes on.

    python -m recipes.studies.exclusion_limits             64 effects -> docs/results/exclusion-limits.json
    python -m recipes.studies.exclusion_limits --rigs swing --records 1 --each 2 --results /tmp/limits
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import envs.rigs
import onlinebayes
from envs.rigs import RIGS
from onlinebayes.runs import BadInput, Progress, write_atomic
from recipes.command import STOPPED, status
from recipes.studies.blind_rigs.workers import work
from recipes.studies.exclusion_limits.probing import Prober
from recipes.studies.exclusion_limits.record import Record, from_json
from recipes.studies.exclusion_limits.table import tabulate
from recipes.studies.job import Job
from recipes.studies.json_line import line
from recipes.studies.resumable import check_names, code_mark, commit_of, kept, print_rows

REPORTED = 2410
"""Seed of a rig's first reported record; none of these was looked at while the search was tuned."""


@dataclass(frozen=True)
class Study:
    """What to run.

    Args:
        records: of each rig.
        each: effects that are put into a record.
        rigs: which.
        first: seed of a rig's first record.
        processes: that share the records.
        minutes: that a record may take, with all its effects; one that takes longer has no answer.
        out: folder of the records that were judged.
        results: folder of the table.
    """

    records: int = 2
    each: int = 4
    rigs: tuple[str, ...] = tuple(RIGS)
    first: int = REPORTED
    processes: int = 2
    minutes: float = 60.0
    out: Path = Path("out/exclusion_limits")
    results: Path = Path("docs/results")

    @property
    def jobs(self) -> list[Job]:
        """All rigs' first records, then their second ones."""
        return [Job(rig, "limits", self.first + k) for k in range(self.records) for rig in self.rigs]


def main(study: Study) -> int:
    """Probe what is not probed yet, write the table and print it; returns the exit status."""
    check_names(study.rigs, RIGS)
    if min(study.processes, study.records, study.each) < 1:
        counts = f"{study.processes} processes, {study.records} records, {study.each} effects"
        raise BadInput(f"{counts} find nothing", "use one or more of each")
    wanted, code, stopped = study.jobs, code_mark((onlinebayes, envs.rigs)), False
    found = kept(study.out, (job.name for job in wanted), from_json)
    print(f"{len(wanted)} records, {len(found)} of them probed before (in {study.out})", file=sys.stderr)
    try:
        probe_all(study, [job for job in wanted if job.name not in found], found, code)
    except KeyboardInterrupt:
        print(f"stopped; {len(found)} of {len(wanted)} records are kept; the same command goes on", file=sys.stderr)
        stopped = True
    table = tabulate([found[name] for name in sorted(found)], len(wanted))
    table.commit = commit_of((probe.code for record in found.values() for probe in record.probes), code)
    print_rows(table)
    print(f"written: {table.write(study.results)}")
    return STOPPED if stopped else 0


def probe_all(study: Study, todo: list[Job], found: dict[str, Record], code: str) -> None:
    """Probe the records, each kept as soon as it is known; ``found`` grows."""
    with Progress("exclusion limits", len(todo) + len(found)) as progress:
        for done in work(todo, Prober(study.each, code), study.processes, 60 * study.minutes):
            record = done.result or Record(done.job.rig, done.job.seed, ended=done.problem)
            write_atomic(study.out / f"{record.name}.json", line(record))
            found[record.name] = record
            seen = f"{sum(probe.found for probe in record.probes)} of {len(record.probes)} found"
            progress.update(len(found), f"{record.name}: {record.ended or seen}")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
