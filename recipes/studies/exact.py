"""``make exact``: the neural posterior beside the exact one, under sensor noise.

| part      | what is compared                                                                          |
|-----------|-------------------------------------------------------------------------------------------|
| one round | n = 1, 3, 6 (30: coverage) trajectories of 50 steps, untrained policy, noise 1 and 5 %, 100 thetas |
| recipes  | what a recipe believes at its end, given all that it measured, seeds 1 to 5, noise 1 %               |

"Ours" is the estimator of the recipes, trained on 1000 single trajectories; "exact" is ``LikelihoodEstimator`` on the
same data: a filter's likelihood with weighted draws, its noise read off the same simulations. Its draws say themselves
whether they are enough: thetas with fewer than 50 effective draws are counted and left out of the comparison.
Each finished job is kept, so that a second start goes on.

    python -m recipes.studies.exact [--tasks pendulum] [--parts recipes]       -> docs/results/exact.json
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any, Literal

import torch

from onlinebayes.experiments import Run, Settings, status
from onlinebayes.inference import filtered_estimator, fit
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.runs import ResultTable, generator, seed_everything
from recipes import cartpole, pendulum
from recipes.studies.jobs import Places, each_kept_or_done, finished
from recipes.studies.table_online import ended, reference

Part = Literal["one round", "recipes"]
TASKS: dict[str, ModuleType] = {"cartpole": cartpole, "pendulum": pendulum}
NOISES, SIZES, MANY = (0.01, 0.05), (1, 3, 6), 30
THETAS, SIMULATIONS, GROUPS, SOUND = 100, 1000, 64, 50.0
ROWS_OF = {"cartpole": "CartPole", "pendulum": "Pendulum"}
SEED, SEEDS = 311, (1, 2, 3, 4, 5)
NEAR = {"cartpole": ("mean", 0.15), "pendulum": ("median", 0.5)}
END = {"cartpole": 5.3, "pendulum": 7.5}


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """which recipes"""
    parts: tuple[Part, ...] = ("recipes", "one round")
    """which parts"""
    out: str = "out/exact"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs: list[tuple[str, Callable[[], dict[str, Any]]]] = []
    for task in study.tasks:
        if "recipes" in study.parts:
            jobs += [(f"{task}-recipe-{seed}", partial(recipe, task, seed)) for seed in SEEDS]
        if "one round" in study.parts:
            jobs += [(f"{task}-{noise:g}", partial(one_round, task, noise)) for noise in NOISES]
    found = each_kept_or_done("exact", study.out, dict(jobs), str, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def recipe(task: str, seed: int) -> dict[str, Any]:
    """One run of a recipe; log density of the truth under its last belief and under the exact posterior."""
    return ended(ROWS_OF[task], 0.01, seed)


def one_round(task: str, noise: float) -> dict[str, Any]:
    """For each n: densities of the truths and the credibilities at which they lie, ours and exact."""
    seed_everything(SEED)
    made: Run = TASKS[task].build(Settings(seed=SEED, noise=noise))
    problem, policy, steps = made.problem, made.trainer.objective.policy, made.trainer.schedule.real_steps
    draw = generator(SEED, "exact")
    train = partial(fit, epochs=25, batch_size=50, learning_rate=1e-3)
    ours = filtered_estimator(problem.simulator, problem.task, state=TASKS[task].state, train=train)(problem.prior)
    exact = reference(made, TASKS[task].state)
    simulated = problem.simulations(SIMULATIONS, steps, SEED + 1).draw([policy], problem.prior)
    groups = problem.simulations(GROUPS, steps, SEED + 2).groups([policy] * max(SIZES), problem.prior)
    judged = problem.simulations(THETAS, steps, SEED + 3).groups([policy] * MANY, problem.prior)
    ours.fit(simulated, groups, generator=draw)
    exact.fit(simulated, generator=draw)
    theta = judged["theta"][:, 0, 0]
    result: dict[str, Any] = {}
    for n in (*SIZES, MANY):
        posterior = ours.each(judged[:, :n])
        result[f"ours {n}"] = posterior.log_prob(theta).tolist()
        result[f"credibility {n}"] = credibility_of(posterior, theta, generator=draw).tolist()
        if n in SIZES:
            truth = exact.each(judged[:, :n])
            result[f"exact {n}"] = truth.log_prob(theta).tolist()
            result[f"exact credibility {n}"] = truth.credibility(theta).tolist()
            result[f"effective {n}"] = truth.effective.tolist()
    return result


def tabled(found: dict[str, dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    some = study.tasks != tuple(TASKS) or len(study.parts) < 2
    told = f" ({', '.join(study.tasks)}: {', '.join(study.parts)})" if some else ""
    table = ResultTable("exact", f"make exact{told}", [SEED, *SEEDS])
    for task in study.tasks:
        runs = [found[name] for seed in SEEDS if (name := f"{task}-recipe-{seed}") in found]
        if runs:
            name = f"{task}, the recipe's end: log density of the truth"
            middle = statistics.median(run["ours"] for run in runs)
            table.add_seeds(name, [run["ours"] for run in runs], unit="nats")
            goal = f"at least {END[task]:g}"
            table.add(f"{name}, median", middle, unit="nats", goal=goal, holds=middle >= END[task])
            table.add_seeds(f"{name}, exact posterior", [run["exact"] for run in runs], unit="nats")
        for noise in NOISES:
            if f"{task}-{noise:g}" in found:
                add_round(table, f"{task}, noise {100 * noise:g} %", task, found[f"{task}-{noise:g}"])
    return table


def add_round(table: ResultTable, name: str, task: str, result: dict[str, Any]) -> None:
    """Rows of one system at one noise."""
    statistic, near = NEAR[task]
    take = statistics.fmean if statistic == "mean" else statistics.median
    for n in SIZES:
        sound = [i for i, number in enumerate(result[f"effective {n}"]) if number >= SOUND]
        ours, exact = ([result[f"{who} {n}"][i] for i in sound] for who in ("ours", "exact"))
        table.add(f"{name}, n = {n}: exact posterior, {statistic}", take(exact), unit="nats")
        below = take(exact) - take(ours)
        goal = f"at most {near:g}"
        table.add(f"{name}, n = {n}: ours below it", below, unit="nats", goal=goal, holds=below <= near)
        spread = statistics.stdev(a - b for a, b in zip(exact, ours, strict=True)) / len(sound) ** 0.5
        table.add(f"{name}, n = {n}: standard error of the mean difference", spread, unit="nats")
        if len(sound) < THETAS:
            table.add(f"{name}, n = {n}: left out, the reference is not sure", THETAS - len(sound), unit="thetas")
        error = coverage_error(result[f"credibility {n}"])
        table.add(f"{name}, n = {n}: coverage error", error, goal="at most 0.05", holds=error <= 0.05)
        table.add(f"{name}, n = {n}: coverage error, exact", coverage_error(result[f"exact credibility {n}"]))
    share = sum(alpha <= 0.95 for alpha in result[f"credibility {MANY}"]) / THETAS
    table.add(f"{name}, n = {MANY}: share in the 95 % region", share, goal="0.92 to 0.98", holds=0.92 <= share <= 0.98)


def coverage_error(credibility: list[float]) -> float:
    """Mean distance between level and coverage, over all levels: .03 for a hundred exact ones."""
    levels = torch.linspace(0.05, 0.95, 19)
    covered = (torch.tensor(credibility)[:, None] <= levels).float().mean(0)
    return float((covered - levels).abs().mean())


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
