"""``make engines``: what parts two physics engines' hoppers, named by criticism from flights.

A hopper thrown into the air in Drake is refined against its model in MuJoCo, which lacks the joints' damping or
armature, or has it where the machine has none (:mod:`.engines_data`). All candidates are tried, by the command as a
user gives it.

| row      | what                                                                                         |
|----------|----------------------------------------------------------------------------------------------|
| named    | seeds for which the law is named at all three joints, and nothing else                         |
| size     | by how much a joint's value misses the machine's, in per cent of Gymnasium's 1.0, the worst   |
| held-out | error of the worst signal over .4 s of runs that were not fitted, in noise floors              |
| time     | processor seconds of the command, start-up included                                          |

Each finished job is kept, so that a second start goes on.

    python -m recipes.studies.engines [--seeds 1]       -> docs/results/engines.json
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from envs.hopper.standard import JOINTS
from onlinebayes.criticism import same_as
from onlinebayes.experiments import status
from onlinebayes.runs import ResultTable
from recipes.studies.engines_data import CASES, Case, written
from recipes.studies.jobs import NOTHING_KEPT, Places, check_names, each_kept_or_done, finished, printed_by

SEEDS = (1, 2, 3)
OFF, SECONDS = 1.0, 180.0
"""Goals: per cent, and processor seconds."""


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    cases: tuple[str, ...] = tuple(case.name for case in CASES)
    """which cases"""
    seeds: tuple[int, ...] = SEEDS
    """of flights and noise"""
    out: str = "out/engines"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    check_names(study.cases, [case.name for case in CASES])
    wanted = [case for case in CASES if case.name in study.cases]
    jobs = {(case.name, seed): partial(judged, case, seed, study.out) for case in wanted for seed in study.seeds}
    found = each_kept_or_done("engines", study.out, jobs, lambda key: "-".join(map(str, key)), study.ray_workers)
    table = ResultTable("engines", printed_by("engines", study), study.seeds)
    for case in wanted:
        add_case(table, case, [found[case.name, seed] for seed in study.seeds])
    return finished(table, study.results, found)


def judged(case: Case, seed: int, out: str) -> dict[str, Any]:
    """Record a case, refine it, and hold the report against the truth."""
    folder = Path(out) / f"{case.name}-{seed}"
    report, seconds = refined(written(case, seed, folder), folder / "report")
    return {**judgement(case, report), "seconds": seconds}


def refined(problem: Path, folder: Path) -> tuple[dict[str, Any], float]:
    """The report of ``onlinebayes refine``, and its processor seconds."""
    command = [sys.executable, "-m", "onlinebayes", "refine", str(problem), "--out", str(folder)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, env={**NOTHING_KEPT, "OMP_NUM_THREADS": "1"}, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return json.loads((folder / "report.json").read_text(encoding="utf-8")), seconds


def judgement(case: Case, report: Mapping[str, Any]) -> dict[str, Any]:
    """Judge a report.

    Args:
        case: what there was to find.
        report: report.json.
    """
    accepted, error = list(report["accepted"]), report["heldout_error"]
    before, after = (
        max(value / error["noise_floor"][signal] for signal, value in error[which].items())
        for which in ("before", "after")
    )
    right = len(accepted) == len(case.sought) and {same_as(key) for key in accepted} == case.sought
    found = sizes(report["parameters"])
    off = max((abs(value - case.machine) for value in found.values()), default=None) if right else None
    return {
        "verdict": report["verdict"],
        "accepted": accepted,
        "right": right,
        "sizes": found if right else {},
        "off": None if off is None else 100 * off,
        "before": before,
        "after": after,
    }


def sizes(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Joint -> what was found there, of an effect or of the model's own number [SI]."""
    found = {}
    for name, value in parameters.items():
        for joint in JOINTS:
            if f"@{joint}." in name or name.startswith(f"joint.{joint}."):
                found[joint] = float(value["mean"])
    return found


def add_case(table: ResultTable, case: Case, results: Sequence[Mapping[str, Any]]) -> None:
    """Rows of one case."""
    side = "missing in" if case.side == "missing" else "surplus of"
    head = f"{case.law} of the joints, {side} the model"
    count, right = len(results), sum(one["right"] for one in results)
    verdicts = ", ".join(one["verdict"] for one in results)
    table.add(
        f"{head}: named at each joint, nothing else",
        f"{right} of {count}",
        spread=verdicts,
        goal="all",
        holds=right == count,
    )
    for seed, one in zip(table.seeds, results, strict=True):
        if not one["right"]:
            table.add(f"MISS {head}, seed {seed}", ", ".join(one["accepted"]) or "nothing", unit=one["verdict"])
    known = [one for one in results if one["right"]]
    if known:
        off = [one["off"] for one in known]
        shown = "; ".join(" ".join(f"{value:.4g}" for value in one["sizes"].values()) for one in known)
        table.add(
            f"{head}: size, largest error", max(off), spread=shown, unit="%", goal=f"<= {OFF:g}", holds=max(off) <= OFF
        )
    table.add_seeds(f"{head}: held-out error before", [one["before"] for one in results], unit="noise floors")
    table.add_seeds(f"{head}: held-out error after", [one["after"] for one in results], unit="noise floors")
    seconds = [one["seconds"] for one in results]
    each, most = " ".join(f"{value:.0f}" for value in seconds), max(seconds)
    table.add(
        f"{head}: time, the longest", most, spread=each, unit="CPU s", goal=f"<= {SECONDS:g}", holds=most <= SECONDS
    )


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
