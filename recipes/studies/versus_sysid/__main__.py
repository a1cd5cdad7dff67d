"""``make versus-sysid``: ours against mujoco.sysid, same data, one run.

Every judged trial (a method on a case) is a file of its own, written at once: a study that was stopped goes on. Its
table, of the cases that all methods were tried on so far, says of how many.

    python -m recipes.studies.versus_sysid                    60 blind cases and EMPS -> docs/results/versus-sysid.json
    python -m recipes.studies.versus_sysid --cases 6 --processes 1 --results /tmp/sysid
"""

from __future__ import annotations

import importlib.util
import os
import sys
from dataclasses import dataclass
from pathlib import Path

import envs.rigs
import onlinebayes
import recipes.studies.versus_sysid
from onlinebayes.experiments import STOPPED, status
from onlinebayes.runs import BadInput, Progress, write_atomic
from recipes.studies.blind_rigs.plan import in_words
from recipes.studies.blind_rigs.workers import work
from recipes.studies.json_line import line
from recipes.studies.resumable import code_mark, commit_of, kept, print_rows
from recipes.studies.versus_sysid.cases import jobs
from recipes.studies.versus_sysid.judging import Judge, Trial, unanswered
from recipes.studies.versus_sysid.record import COST, METHODS, Outcome, from_json
from recipes.studies.versus_sysid.table import tabulate

NEEDED = ("colorama", "tabulate", "yaml", "imageio", "plotly")


@dataclass(frozen=True)
class Study:
    """What to run.

    Args:
        cases: number of blind cases; EMPS comes on top where ``ONLINEBAYES_DATA`` is set.
        processes: that share the trials.
        minutes: that a method may take on a case; one that takes longer has no answer.
        out: folder of the judged trials.
        results: folder of the table.
    """

    cases: int = 60
    processes: int = 2
    minutes: float = 10.0
    out: Path = Path("out/versus_sysid")
    results: Path = Path("docs/results")

    @property
    def trials(self) -> list[Trial]:
        """All methods on a case, then the next case."""
        wanted = jobs(self.cases, bool(os.environ.get("ONLINEBAYES_DATA")))
        return [Trial(job, method) for job in wanted for method in (*METHODS, COST)]

    @property
    def kept(self) -> Path:
        """Folder of one file a trial."""
        return self.out / "trials"


def main(study: Study) -> int:
    """Try what is not tried yet, write the table and print its overall rows; returns the exit status."""
    if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        raise BadInput(f"{', '.join(missing)} not installed", "pip install -c constraints.txt -e '.[peers]'")
    if study.processes < 1 or study.cases < 0:
        raise BadInput(f"{study.processes} processes, {study.cases} cases", "use one process or more, no case or more")
    wanted, code = study.trials, code_mark((onlinebayes, envs.rigs, recipes.studies.versus_sysid))
    found = kept(study.kept, (trial.name for trial in wanted), from_json)
    print(f"{len(wanted)} trials, {len(found)} of them judged before (in {study.kept})", file=sys.stderr)
    if old := sum(outcome.code != code for outcome in found.values()):
        print(f"{old} of them by other code: remove their files to go anew", file=sys.stderr)
    stopped = False
    try:
        judge_all(study, [trial for trial in wanted if trial.name not in found], found, code)
    except KeyboardInterrupt:
        print(f"stopped; {len(found)} of {len(wanted)} trials are kept; the same command goes on", file=sys.stderr)
        stopped = True
    whole = study.cases == Study.cases
    command = "make versus-sysid" if whole else f"python -m recipes.studies.versus_sysid --cases {study.cases}"
    table = tabulate(list(found.values()), command, len({trial.job.name for trial in wanted}))
    table.commit = commit_of((outcome.code for outcome in found.values()), code)
    print_rows(table)
    print(f"written: {table.write(study.results)}")
    return STOPPED if stopped else 0


def judge_all(study: Study, todo: list[Trial], found: dict[str, Outcome], code: str) -> None:
    """Judge the trials, each kept as soon as it is known; ``found`` grows."""
    spent = 0.0
    with Progress("versus sysid", len(todo) + len(found)) as progress:
        tried = work(todo, Judge(code), study.processes, 60 * study.minutes)
        for number, done in enumerate(tried, 1):
            outcome = done.result or unanswered(done.job, done.problem, done.seconds, code)
            write_atomic(study.kept / f"{outcome.name}.json", line(outcome))
            found[outcome.name] = outcome
            spent += done.seconds
            left = in_words(spent / number * (len(todo) - number) / study.processes)
            progress.update(len(found), f"{outcome.name}: {_told(outcome)}; about {left} to go")


def _told(outcome: Outcome) -> str:
    if outcome.ended:
        return outcome.ended
    if outcome.method == COST:
        return f"{outcome.seconds:.1f} s against {outcome.reference:.1f} s"
    return f"{outcome.error:.3g} floors, {', '.join(outcome.claims) or 'nothing'}"


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
