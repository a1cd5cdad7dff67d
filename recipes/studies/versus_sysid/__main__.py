"""``make versus-sysid``: ours against mujoco.sysid, same data, one run.

Every judged trial (a method on a case) is kept as soon as it is known: a study that was stopped goes on. Its table, of
the cases that all methods were tried on so far, says of how many.

    python -m recipes.studies.versus_sysid                    50 blind cases and EMPS -> docs/results/versus-sysid.json
    python -m recipes.studies.versus_sysid --cases 5 --processes 1 --results /tmp/sysid
"""

from __future__ import annotations

import importlib.util
import os
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from onlinebayes.experiments import STOPPED, status
from onlinebayes.runs import BadInput
from recipes.studies.jobs import each_kept_or_done, print_rows, printed_by, record
from recipes.studies.versus_sysid.cases import jobs
from recipes.studies.versus_sysid.judging import COST, Outcome, Trial, tried, unanswered
from recipes.studies.versus_sysid.methods import METHODS
from recipes.studies.versus_sysid.table import tabulate

NEEDED = ("colorama", "tabulate", "yaml", "imageio", "plotly")


@dataclass(frozen=True)
class Study:
    """Options of the study.

    Args:
        cases: number of blind cases; EMPS comes on top where ``ONLINEBAYES_DATA`` is set.
        processes: that share the trials.
        minutes: that a method may take on a case; one that takes longer has no answer.
        out: folder of the judged trials.
        results: folder of the table.
    """

    cases: int = 50
    processes: int = 2
    minutes: float = 10.0
    out: Path = Path("out/versus_sysid")
    results: Path = Path("docs/results")

    @property
    def trials(self) -> list[Trial]:
        """All methods on a case, then the next case."""
        wanted = jobs(self.cases, bool(os.environ.get("ONLINEBAYES_DATA")))
        return [(job, method) for job in wanted for method in (*METHODS, COST)]


def main(study: Study) -> int:
    """Try what is not tried yet, write the table and print its overall rows; returns the exit status."""
    if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        raise BadInput(f"{', '.join(missing)} not installed", "pip install -c constraints.txt -e '.[peers]'")
    found = each_kept_or_done(
        "versus-sysid",
        study.out / "trials",
        {trial: partial(tried, trial) for trial in study.trials},
        lambda trial: f"{trial[0].name}.{trial[1]}",
        processes=study.processes,
        limit=60 * study.minutes,
        failed=unanswered,
    )
    outcomes = [record(Outcome, result) for result in found.values()]
    command = printed_by("versus-sysid", study)
    table = tabulate(outcomes, command, len({job.name for job, _ in study.trials}))
    table.commit = found.commit
    print_rows(table)
    print(f"written: {table.write(study.results)}")
    return STOPPED if found.stopped else 0


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
