"""Parts that the studies of measured machines share: ``refine`` as a user runs it, and the rows that every set reports.

A set has three parts:

| where                                 | what                                                                      |
|---------------------------------------|---------------------------------------------------------------------------|
| ``envs/measured/SET/``                | ``model.xml``, ``problem.toml``, ``README.md``                            |
| ``recipes/studies/measured_sets/SET`` | ``judge(data: Path) -> tuple[Row, ...]``: refines, holds it against goals |
| ``$ONLINEBAYES_DATA``                 | the measurements: ``measurements = ["$ONLINEBAYES_DATA/SET/log.csv"]``    |

``make measured`` finds every module of ``measured_sets``.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from envs.measured import FOLDER
from onlinebayes.runs import BadInput, Row
from recipes.studies.jobs import NOTHING_KEPT

OUT = Path("out/measured")
UNITS = {"rad": ("mrad", 1e3), "m": ("mm", 1e3)}


@dataclass(frozen=True)
class Refined:
    """Report of one ``onlinebayes refine``.

    Args:
        name: of the set, before every row.
        report: report.json.
        seconds: processor time of the command, start-up included [s].
    """

    name: str
    report: Mapping[str, Any]
    seconds: float

    @property
    def accepted(self) -> tuple[str, ...]:
        """Keys of the effects accepted, in order."""
        return tuple(self.report["accepted"])

    def error(self, which: str, signal: str) -> float:
        """Held-out error of one signal: ``"before"``, ``"after"`` or its ``"noise_floor"`` [the signal's unit]."""
        return float(self.report["heldout_error"][which][signal])

    def by_run(self, signal: str) -> dict[str, tuple[float, float]]:
        """Held-out run -> RMS of its windows' errors before and after [the signal's unit]."""
        squares: dict[str, list[tuple[float, float]]] = {}
        for window in self.report["detail"]["windows"]:
            if window["held_out"] and window["signal"] == signal:
                squares.setdefault(window["run"], []).append((window["before"] ** 2, window["after"] ** 2))
        return {
            run: (_root_mean(a for a, _ in pairs), _root_mean(b for _, b in pairs)) for run, pairs in squares.items()
        }

    def rows(self, goal: str, holds: bool, units: Mapping[str, str], longest: float = 120.0) -> tuple[Row, ...]:
        """Verdict, effects, held-out errors with their floors (which must not rise), parameters and time.

        Args:
            goal, holds: what should have been accepted, in words, and whether it was.
            units: signal to report -> its unit, ``"rad"``, ``"m"``, ``"rad/s"``, ...
            longest: processor time that the command may take [s].
        """
        accepted = ", ".join(self.accepted) or "none"
        found = [
            Row(f"{self.name}: verdict", self.report["verdict"]),
            Row(f"{self.name}: effects accepted, in order", accepted, goal=goal, holds=holds),
        ]
        for signal, unit in units.items():
            shown, factor = UNITS.get(unit, (unit, 1.0))
            horizon = self.report["heldout_error"]["horizon_s"][signal]
            for which in ("before", "after", "noise_floor"):
                name = f"{self.name}: held-out {signal} over {horizon:.3g} s, {which.replace('_', ' ')}"
                found.append(Row(name, factor * self.error(which, signal), unit=shown))
            fall = self.error("before", signal) / self.error("after", signal)
            found.append(
                Row(f"{self.name}: fall of that error", fall, unit="times", goal="none rises", holds=fall >= 1)
            )
        for address, value in self.report["parameters"].items():
            found.append(Row(f"{self.name}: {address}", value["mean"], value["sd"], value["unit"]))
        name, held = f"{self.name}: processor time of refine, start-up included", self.seconds <= longest
        found.append(Row(name, self.seconds, unit="s", goal=f"<= {longest:g}", holds=held))
        return tuple(found)


def rows_by_gain(refined: Refined, wanted: str, signal: str, goals: Mapping[str, float]) -> tuple[Row, ...]:
    """Rows of a servo at several gains, one held-out run of each.

    Args:
        refined: what was said.
        wanted: the effect that should be among those accepted.
        signal: an angle.
        goals: gain, as its run's name begins -> the most that its error after may be [rad].
    """
    rows = list(refined.rows(f"{wanted} among them", wanted in refined.accepted, {signal: "rad"}))
    for run, (before, after) in refined.by_run(signal).items():
        gain = run.partition("-")[0]
        most, name = goals[gain], f"{refined.name}: held-out error at {gain}"
        rows.append(Row(f"{name}, before", 1e3 * before, unit="mrad"))
        rows.append(Row(f"{name}, after", 1e3 * after, unit="mrad", goal=f"<= {1e3 * most:g}", holds=after <= most))
    return tuple(rows)


def _root_mean(squares: Iterable[float]) -> float:
    values = list(squares)
    return math.sqrt(sum(values) / len(values))


def refine(name: str, data: Path, out: Path = OUT, problem: Path | None = None) -> Refined:
    """Run ``onlinebayes refine envs/measured/NAME/problem.toml``, as from a shell; the report goes to ``out / NAME``.

    Args:
        name: of the set.
        data: folder of the measurements.
        out: folder of the reports.
        problem: a problem file that comes with the measurements, in the place of that one.
    """
    folder = out / name
    (folder / "report.json").unlink(missing_ok=True)
    problem = problem or FOLDER / name / "problem.toml"
    command = [sys.executable, "-m", "onlinebayes.cli.main", "refine", str(problem), "--out", str(folder)]
    process = subprocess.Popen(command, env={**NOTHING_KEPT, "ONLINEBAYES_DATA": str(data)})
    _, ended, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(ended)
    if process.returncode:
        raise BadInput(f"onlinebayes refine {problem} ended with {process.returncode}", "run it by hand")
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    return Refined(name, report, usage.ru_utime + usage.ru_stime)
