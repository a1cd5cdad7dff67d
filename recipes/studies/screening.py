"""``make screening``: all candidates of six joints screened by the model's own method and by the cheaper one, in turns.

Both ways screen the same fit on one machine in one run. Of the times the median is given; of z how far the cheaper way
is off where a candidate promises to lower the error by a hundredth or more. Why: docs/decisions/0026.

    python -m recipes.studies.screening        -> docs/results/screening.json
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import torch
import tyro

from envs.rigs import RIGS
from onlinebayes.cli.problem import load_problem
from onlinebayes.criticism import Screened, by_cheaper_method, ground, prepare, propose, screen, trials
from onlinebayes.identification import flip_groups, residual_correlation_time
from onlinebayes.runs import ResultTable
from recipes.studies.cost import SEED, lengthened, problem
from recipes.studies.exits import status

PROMISING = 0.01  # of the error


@dataclass(frozen=True)
class Study:
    """What to time.

    Args:
        rig: whose candidates.
        effect: that is hidden.
        runs: of four seconds.
        repeats: of each way.
        results: folder of the table.
    """

    rig: str = "six_joint_arm"
    effect: str = "dry_friction@j2"
    runs: int = 15
    repeats: int = 3
    results: Path = Path("docs/results")


def main(study: Study) -> None:
    """Screen both ways in turns and write the table."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        asked = load_problem(problem(lengthened(RIGS[study.rig], study.runs, 4.0), study.effect, Path(folder)))
    task = prepare(asked.simulator, asked.measurement, asked.holdout, asked.selection, asked.scope)
    grounds = ground(task.simulator, task.fit_runs, task.selection)
    fitted, windows = grounds.fitted, grounds.windows
    effects = propose(fitted.simulator, windows)
    groups, tried = flip_groups(windows, residual_correlation_time(fitted, windows)), len(trials(effects))
    own: list[float] = []
    cheap: list[float] = []
    for _ in range(study.repeats):
        began = time.monotonic()
        exact = screen(fitted, windows, effects, groups)
        own.append(time.monotonic() - began)
        began = time.monotonic()
        quick = screen(by_cheaper_method(fitted, windows, tried), windows, effects, groups)
        cheap.append(time.monotonic() - began)
    results = ResultTable("screening", "make screening", [SEED])
    results.add("candidates", len(effects))
    results.add("replays that screening takes", tried)
    results.add("by the model's own method, median", median(own), spread=_range(own), unit="s")
    results.add("by the cheaper one, median", median(cheap), spread=_range(cheap), unit="s")
    ratio = median(own) / median(cheap)
    results.add("the former over the latter", ratio, unit="times", goal="at least 2", holds=ratio >= 2)
    worst, compared = _largest_difference(exact, quick)
    name = f"largest relative difference of z, of {compared} that promise a hundredth or more"
    results.add(name, worst, goal="at most 0.05", holds=worst <= 0.05)
    first = (exact[0].effect.key, quick[0].effect.key)
    results.add("first by each", ", ".join(first), goal="the same", holds=first[0] == first[1])
    print(results.to_markdown())
    print(f"written: {results.write(study.results)}")


def _range(seconds: Sequence[float]) -> str:
    return f"{min(seconds):.3g} to {max(seconds):.3g}"


def _largest_difference(exact: Sequence[Screened], quick: Sequence[Screened]) -> tuple[float, int]:
    """Of the z of what promises something, relative; and of how many."""
    other = {one.effect.key: one.z for one in quick}
    off = [
        abs((other[one.effect.key] or 0.0) - one.z) / abs(one.z) for one in exact if one.z and one.promise >= PROMISING
    ]
    return max(off, default=0.0), len(off)


if __name__ == "__main__":
    sys.exit(status("screening", lambda: main(tyro.cli(Study))))
