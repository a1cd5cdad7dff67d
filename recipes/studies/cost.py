"""``make cost``: what an answer costs, in seconds and memory, each command anew, start-up included.

| part       | what is run                                                                                 |
|------------|---------------------------------------------------------------------------------------------|
| arm        | two links, 40 s at 200 Hz, dry friction hidden in the elbow: ``refine``                       |
| long log   | the same arm, 500 s at 200 Hz, 100 000 rows: ``refine``                                      |
| six joints | six joints under feedback, 60 s at 200 Hz, dry friction hidden in joint 2: ``compare``, ``refine`` |
| next       | the arm, six runs of 10 s: ``next``, the search before it and the plan                        |
| anytime    | the arm and the six joints: ``refine --budget`` for some seconds, and the held-out error then |
| growth     | the arm's ``diagnose`` with 1, 2 and 4 times the data, and with a quarter, half and all candidates |

Growth is the slope of log t against log size, the start-up (the same command on a second of data) taken off: 1 is
linear. EMPS is timed by ``make measured``.

    python -m recipes.studies.cost [--parts arm growth]        -> docs/results/cost.json
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from envs.rigs import RIGS, Rig, sized_case, write_case
from onlinebayes.experiments import status
from onlinebayes.runs import BadInput, ResultTable, cores
from recipes.studies.jobs import NOTHING_KEPT

Part = Literal["arm", "long log", "growth", "six joints", "next", "anytime"]
MEMORY = 4.0  # GB
WALL = 0.65
FIRST = 10.0
"""Processor time until an effect is named for the first time, still to be fitted [s]."""
BUDGETS = (10, 30, 60, 300)
"""Processor time after which a search is asked for what it has [s]."""

SEED = 0
REPORTS = {"next": "next.json"}
"""The file in which a command says its answer, where it is not report.json."""


@dataclass(frozen=True)
class Study:
    """Options of the study.

    Args:
        parts: which.
        results: folder of the table.
    """

    parts: tuple[Part, ...] = get_args(Part)
    results: Path = Path("docs/results")


@dataclass(frozen=True)
class Cost:
    """Cost of a command.

    Args:
        seconds: wall time, start-up included [s].
        processor: processor time of all threads [s].
        memory: largest resident set [GB].
        report: its report.json.
        first: processor time until an effect was named for the first time, infinite where none was [s].
    """

    seconds: float
    processor: float
    memory: float
    report: dict[str, Any]
    first: float


def lengthened(rig: Rig, runs: int, seconds: float) -> Rig:
    """The rig recorded at 200 Hz for that many runs of ``seconds`` [s] to fit, one more held out."""
    step = 0.005 / rig.protocol.period
    return replace(rig, protocol=replace(rig.protocol, step=step, fit=runs, held=1, seconds=seconds))


def problem(rig: Rig, effect: str, folder: Path) -> Path:
    """A case of that rig that hides the effect at its medium size, as files; the path of its problem file."""
    hidden = next(one for one in rig.effects if one.key == effect)
    return write_case(sized_case(rig, hidden, 1.0, SEED), folder)


def spent(command: str, problem_file: Path, budget: float | None = None) -> Cost:
    """Run ``onlinebayes COMMAND`` on it, within so much processor time of the search [s].

    Raises:
        BadInput: the command fails.
    """
    out = problem_file.parent / command
    words = [sys.executable, "-m", "onlinebayes.cli.main", command, str(problem_file), "--out", str(out)]
    words += [] if budget is None else ["--budget", str(budget)]
    began = time.monotonic()
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=NOTHING_KEPT)
    assert process.stderr is not None
    first = math.inf
    for line in process.stderr:
        sys.stderr.write(line)
        if "so far: " in line and "@" in line:
            first = min(first, _processor(process.pid))
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.monotonic() - began
    if process.returncode is None:
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise BadInput(f"onlinebayes {command} {problem_file} ended with {process.returncode}", "run it by hand")
    report = json.loads((out / REPORTS.get(command, "report.json")).read_text(encoding="utf-8"))
    return Cost(seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024**2, report, first)


def _processor(pid: int) -> float:
    """Processor time of a process until now [s]."""
    words = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return sum(int(word) for word in words[11:13]) / os.sysconf("SC_CLK_TCK")


def arm(results: ResultTable, folder: Path) -> None:
    """A two-link arm with 40 s of data."""
    file = problem(lengthened(RIGS["two_link_arm"], 8, 5.0), "dry_friction@elbow", folder / "arm")
    add(results, "two-link arm, 40 s at 200 Hz, refine", spent("refine", file), 30.0)


def long_log(results: ResultTable, folder: Path) -> None:
    """The same arm with 100 000 rows."""
    file = problem(lengthened(RIGS["two_link_arm"], 100, 5.0), "dry_friction@elbow", folder / "long")
    add(results, "two-link arm, 100 000 rows, refine", spent("refine", file), 90.0)


def six_joints(results: ResultTable, folder: Path) -> None:
    """Six joints with a minute of data."""
    file = problem(lengthened(RIGS["six_joint_arm"], 15, 4.0), "dry_friction@j2", folder / "six")
    add(results, "six joints, 60 s at 200 Hz, compare", spent("compare", file), 15.0)
    refined = spent("refine", file)
    add(results, "six joints, 60 s at 200 Hz, refine", refined, 120.0)
    tried = refined.report["candidates_tried"]
    results.add("six joints: candidates tried", tried, goal="150 or more", holds=tried >= 150)


def add(results: ResultTable, name: str, cost: Cost, limit: float) -> None:
    """Rows of a command's time and memory."""
    spent = cost.processor
    results.add(f"{name}, processor time", spent, unit="s", goal=f"at most {limit:g}", holds=spent <= limit)
    results.add(f"{name}, wall time", cost.seconds, unit="s")
    share = cost.seconds / spent
    held = share <= WALL if cores() == 2 else None
    results.add(f"{name}, wall over processor time", share, goal=f"at most {WALL:g} on two cores", holds=held)
    results.add(f"{name}, memory", cost.memory, unit="GB", goal=f"under {MEMORY:g}", holds=cost.memory < MEMORY)
    if math.isfinite(cost.first):
        row = f"{name}, processor time until an effect is named"
        results.add(row, cost.first, unit="s", goal=f"at most {FIRST:g}", holds=cost.first <= FIRST)
    if "accepted" in cost.report:
        results.add(f"{name}, what it named", ", ".join(cost.report["accepted"]) or "nothing")


def plan(results: ResultTable, folder: Path) -> None:
    """The next recording, after six runs of 10 s."""
    file = problem(lengthened(RIGS["two_link_arm"], 6, 10.0), "dry_friction@elbow", folder / "plan")
    add(results, "two-link arm, six runs of 10 s at 200 Hz, next", spent("next", file), 60.0)


def anytime(results: ResultTable, folder: Path) -> None:
    """The held-out error of the answer that a search gives when its budget is spent."""
    two = problem(lengthened(RIGS["two_link_arm"], 8, 5.0), "dry_friction@elbow", folder / "two")
    six = problem(lengthened(RIGS["six_joint_arm"], 15, 4.0), "dry_friction@j2", folder / "all")
    for name, file in (("two-link arm, 40 s at 200 Hz", two), ("six joints, 60 s at 200 Hz", six)):
        for budget in BUDGETS:
            cost = spent("refine", file, budget)
            error = cost.report["heldout_error"]
            worst = max(error["after"], key=lambda signal: error["before"][signal] / error["noise_floor"][signal])
            named = ", ".join(cost.report["accepted"]) or "nothing"
            results.add(
                f"{name}, budget {budget} s: held-out error of {worst}, before and after",
                f"{error['before'][worst]:.3g}, {error['after'][worst]:.3g}",
                spread=f"named {named}; {cost.processor:.0f} s of processor time in all",
            )


def growth(results: ResultTable, folder: Path) -> None:
    """Add the rows on how the time grows with data and with candidates."""
    rig = RIGS["two_link_arm"]
    start = spent("diagnose", problem(lengthened(rig, 1, 1.0), "dry_friction@elbow", folder / "start")).processor
    sizes, times = (4, 8, 16), []
    for runs in sizes:
        file = problem(lengthened(rig, runs, 5.0), "dry_friction@elbow", folder / f"runs{runs}")
        cost = spent("diagnose", file)
        times.append(cost.processor - start)
        results.add(f"two-link arm, {5 * runs} s of data, diagnose, processor time", cost.processor, unit="s")
    add_slope(results, "growth with data", sizes, times)
    # The model's own numbers and values of each run are always tried; a problem file chooses among effects.
    tried = [
        row["effect"]
        for row in cost.report["candidates"]
        if "@" in row["effect"] and " in each run" not in row["effect"]
    ]
    file, parts, times = folder / "runs8" / "problem.toml", (4, 2, 1), []
    text = file.read_text(encoding="utf-8")
    for part in parts:
        # Every fourth of them, whatever their rank: an even sample of cheap and dear ones.
        some = json.dumps(sorted(tried)[::part])
        named = file.with_name(f"part{part}.toml")
        named.write_text(f"{text}\n[effects]\ncandidates = {some}\n", encoding="utf-8")
        cost = spent("diagnose", named)
        times.append(cost.processor - start)
        results.add(
            f"two-link arm, {len(tried[::part])} candidates, diagnose, processor time", cost.processor, unit="s"
        )
    add_slope(results, "growth with candidates", [len(tried[::part]) for part in parts], times)


def add_slope(results: ResultTable, name: str, sizes: Sequence[float], times: Sequence[float]) -> None:
    """A row of the slope of log time against log size."""
    slope = float(np.polyfit([math.log(size) for size in sizes], [math.log(max(t, 1e-3)) for t in times], 1)[0])
    results.add(name, slope, unit="slope of log t against log size", goal="at most 1.1", holds=slope <= 1.1)


def main(study: Study) -> None:
    """Time the parts and write the table."""
    parts = {
        "arm": arm,
        "long log": long_log,
        "growth": growth,
        "six joints": six_joints,
        "next": plan,
        "anytime": anytime,
    }
    some = "" if set(study.parts) == set(parts) else f" ({', '.join(study.parts)})"
    results = ResultTable("cost", f"make cost{some}", [SEED])
    with tempfile.TemporaryDirectory() as folder:
        for part in study.parts:
            parts[part](results, Path(folder))
            print(results.to_markdown(), flush=True)
    print(f"written: {results.write(study.results)}")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
