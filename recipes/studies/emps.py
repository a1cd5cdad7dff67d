"""Refine the EMPS drive, a real machine, as a user would from the command line.

Fitted on the run ``plain``; the run ``pulses``, in which the reference carries added pulses, is held out. Published
values of the benchmark for comparison: 95.1 kg, 203.5 N s/m, 20.4 N of dry friction, 3.16 N of load.

    ONLINEBAYES_DATA=/path/to/data python -m recipes.studies.emps        -> docs/results/emps.json
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from envs.measured import FOLDER
from onlinebayes.experiments import status
from onlinebayes.runs import BadInput, ResultTable

SIGNAL = "qpos.carriage"
PROBLEM = FOLDER / "emps" / "problem.toml"


@dataclass(frozen=True)
class Study:
    """Where the result and the report go.

    Args:
        results: folder of emps.json.
        report: folder of report.html and run.rrd.
    """

    results: Path = Path("docs/results")
    report: Path = Path("out/emps")


def refine(folder: Path) -> tuple[dict[str, Any], float]:
    """Run the command on its own, as from a shell; its report and the seconds it took, start-up included."""
    if not os.environ.get("ONLINEBAYES_DATA"):
        raise BadInput("ONLINEBAYES_DATA is not set", "set it to the folder that holds emps/emps.csv")
    command = [
        sys.executable,
        "-m",
        "onlinebayes.cli.main",
        "refine",
        str(PROBLEM),
        "--out",
        str(folder),
    ]
    (folder / "report.json").unlink(missing_ok=True)
    began = time.monotonic()
    subprocess.run(command, check=True)
    seconds = time.monotonic() - began
    return json.loads((folder / "report.json").read_text(encoding="utf-8")), seconds


def table(report: dict[str, Any], seconds: float) -> ResultTable:
    """The figures with their goals."""
    results = ResultTable("emps", "make emps", [0])
    accepted, error = report["accepted"], report["heldout_error"]
    before, after = 1e3 * error["before"][SIGNAL], 1e3 * error["after"][SIGNAL]
    wanted = ["dry_friction@carriage", "constant_load@carriage"]
    results.add("verdict", report["verdict"])
    results.add(
        "effects accepted, in order",
        ", ".join(accepted),
        goal="dry_friction, then constant_load",
        holds=accepted[:2] == wanted,
    )
    results.add("held-out error over one second, before", before, unit="mm")
    results.add("held-out error over one second, after", after, unit="mm", goal="below 2.2", holds=after < 2.2)
    fall = before / after
    results.add("fall of the held-out error", fall, unit="times", goal="at least 2.5", holds=fall >= 2.5)
    results.add("time of refine, start-up included", seconds, unit="s", goal="under 30 on 2 cores", holds=seconds < 30)
    for name, estimate in report["parameters"].items():
        results.add(name, estimate["mean"], spread=estimate["sd"], unit=estimate["unit"])
    for step in report["steps"]:
        results.add(f"score gain of {step['added']}", step["score_gain"], spread=step["score_gain_se"], unit="nats")
    return results


def main(study: Study) -> None:
    """Run the study and print its figures."""
    report, seconds = refine(study.report)
    results = table(report, seconds)
    path = results.write(study.results)
    print(results.to_markdown())
    print(f"written: {path}; report: {study.report / 'report.html'}")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
