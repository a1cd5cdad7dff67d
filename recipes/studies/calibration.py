"""``make calibration``: does each estimator's posterior mean what it says? On four systems, one to thirty trajectories.

| part      | what is judged                                                                                    |
|-----------|---------------------------------------------------------------------------------------------------|
| amortised | every estimator, 1000 simulations, 500 thetas, n = 1, 6, 30 trajectories of each                    |
| alarm     | measurements of a system with a hidden effect, and clean ones: how often does the alarm ring?     |

TARP error: the mean over levels of | share of truths inside the ball of that credibility - level | (Lemos et al. 2023);
for an exact posterior .014 with 500 thetas. Sensors have 1 % noise. Each finished job is kept.

    python -m recipes.studies.calibration [--tasks pendulum] [--parts amortised]       -> docs/results/calibration.json
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import process_time
from typing import Any, Literal

import torch

from onlinebayes.experiments import status
from onlinebayes.inference import NeuralEstimator
from onlinebayes.inference.calibration import ball_credibility, credibility_of
from onlinebayes.runs import ResultTable
from recipes.studies.exact import coverage_error
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by
from recipes.studies.one_round import ESTIMATORS, TASKS, OneRound, begun
from recipes.studies.ringing import SIZES as EFFECT_SIZES
from recipes.studies.ringing import way

Part = Literal["amortised", "alarm"]
NOISE, SIMULATIONS, THETAS, COMBINED_BY, SIZES = 0.01, 1000, 500, 64, (1, 6, 30)
SEED, MOST = 521, 0.05


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """which recipes"""
    parts: tuple[Part, ...] = ("amortised", "alarm")
    """which parts"""
    estimators: tuple[str, ...] = tuple(ESTIMATORS)
    """which of the amortised ones"""
    out: str = "out/calibration"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs = jobs_of(study)
    found = each_kept_or_done("calibration", study.out, jobs, lambda name: name.replace(" ", "_"), study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def jobs_of(study: Study) -> dict[str, Callable[[], dict[str, Any]]]:
    """Name -> job."""
    jobs: dict[str, Callable[[], dict[str, Any]]] = {}
    for task in study.tasks:
        if "amortised" in study.parts:
            jobs |= {f"{task}, {name}": partial(amortised, task, name) for name in study.estimators}
        if "alarm" in study.parts and task in EFFECT_SIZES:
            jobs[f"{task}, alarm"] = partial(way, task, SEED, NOISE)
    return jobs


def amortised(task: str, name: str) -> dict[str, Any]:
    """One estimator on one system: for each n the log densities and both credibilities of all truths."""
    draw = begun(SEED)
    return judged(OneRound.of(task, SEED, NOISE), name, SIMULATIONS, THETAS, SIZES, draw)


def judged(
    one: OneRound, name: str, simulations: int, thetas: int, sizes: tuple[int, ...], draw: torch.Generator
) -> dict[str, Any]:
    """The same of any system.

    Args:
        one: the system and an untrained policy.
        name: of the estimator.
        simulations, thetas: to fit on, and to judge by.
        sizes: numbers of trajectories n of one theta.
        draw: random numbers of the fit and of the judges.
    """
    simulated, told = one.simulated(simulations), one.groups(thetas, max(sizes), 3)
    combined_by = one.groups(COMBINED_BY, max(sizes), 2)
    estimator = ESTIMATORS[name](one, simulated)
    began = process_time()
    estimator.fit(simulated, generator=draw)
    result: dict[str, Any] = {"seconds": process_time() - began}
    theta = told["theta"][:, 0, 0]
    for n in sizes:
        if isinstance(estimator, NeuralEstimator):
            estimator.calibrate(combined_by[:, :n], generator=draw)
            result[f"combination {n}"] = str(estimator.combination)
        posterior = estimator.each(told[:, :n])
        result[f"density {n}"] = posterior.log_prob(theta).tolist()
        result[f"region {n}"] = credibility_of(posterior, theta, generator=draw).tolist()
        result[f"ball {n}"] = ball_credibility(posterior, theta, one.problem.space, generator=draw).tolist()
    return result


def tabled(found: dict[str, dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    table = ResultTable("calibration", printed_by("calibration", study), [SEED])
    for name, result in found.items():
        if "rings" in result:
            add_alarm(table, name, result)
            continue
        for n in SIZES:
            if f"ball {n}" in result:
                add_cell(table, f"{name}, n = {n}", n, result)
        table.add(f"{name}: fit, processor time", result["seconds"], unit="s")
    return table


def add_cell(table: ResultTable, name: str, n: int, result: dict[str, Any]) -> None:
    """One estimator, one system, one n."""
    density, error = torch.tensor(result[f"density {n}"]), coverage_error(result[f"ball {n}"])
    kept = density[density.isfinite()]
    table.add(f"{name}: density of the truth", float(kept.mean()), spread=float(kept.median()), unit="nats")
    if excluded := len(density) - len(kept):
        table.add(f"{name}: truths that it excludes, not counted above, of {len(density)}", excluded)
    table.add(f"{name}: TARP error", error, goal=f"at most {MOST:g}", holds=error <= MOST)
    table.add(f"{name}: coverage error", coverage_error(result[f"region {n}"]))


def add_alarm(table: ResultTable, name: str, result: dict[str, Any]) -> None:
    """Add the rows on how often the alarm rang."""
    clean, moved = (
        result["clean"],
        [ring for ring, away in zip(result["rings"], result["away"], strict=True) if away > 2],
    )
    share = sum(clean) / len(clean)
    table.add(f"{name}: rings on clean measurements", share, goal="at most 0.05", holds=share <= 0.05)
    table.add(f"{name}: measurements whose posterior the effect moves by over 2 sd", len(moved))
    if moved:
        share = sum(moved) / len(moved)
        table.add(f"{name}: rings on these", share, goal="at least 0.9", holds=share >= 0.9)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
