"""``make embeddings``: what each embedding is worth, on four systems, before the same mixture density network.

1000 simulations of 50 steps, 1 % noise, an untrained policy; judged on one trajectory of each of 500 thetas: mean log
density of the truth, TARP error (see ``make calibration``), processor time of the fit. The prior's density stands
beside them: an embedding that ends below it has told nothing.

    python -m recipes.studies.embeddings [--tasks pendulum]       -> docs/results/embeddings.json
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from onlinebayes.experiments import status
from onlinebayes.inference.calibration import ball_credibility
from onlinebayes.runs import ResultTable
from recipes.studies.calibration import NOISE, SIMULATIONS, THETAS
from recipes.studies.exact import coverage_error
from recipes.studies.one_round import EMBEDDINGS, TASKS, OneRound, begun, mixture
from recipes.studies.resumable import each_kept_or_done

SEEDS = (531, 532)


@dataclass(frozen=True)
class Study:
    """What to compare."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """which recipes"""
    embeddings: tuple[str, ...] = tuple(EMBEDDINGS)
    """which embeddings"""
    seeds: tuple[int, ...] = SEEDS
    """of simulations, networks and judges"""
    out: str = "out/embeddings"
    """finished jobs go here"""
    results: Path = Path("docs/results")
    """folder of the table"""
    ray_workers: int = 0
    """workers on Ray that do the jobs; 0: this process does, one after the other"""


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs = {
        (task, name, seed): partial(told_by, task, name, seed)
        for task in study.tasks
        for name in study.embeddings
        for seed in study.seeds
    }
    found = each_kept_or_done("embeddings", study.out, jobs, file_of, study.ray_workers)
    table = tabled(found, study)
    table.commit = found.commit
    print(table.to_markdown())
    print(f"written: {table.write(study.results)}")
    return 0 if table.holds else 1


def file_of(key: tuple[str, str, int]) -> str:
    """Name of a job's file."""
    return ", ".join(map(str, key)).replace(" ", "_")


def told_by(task: str, name: str, seed: int) -> dict[str, Any]:
    """One embedding on one system."""
    draw = begun(seed)
    one = OneRound.of(task, seed, NOISE)
    simulated, judged = one.simulated(SIMULATIONS), one.groups(THETAS, 1, 3)
    estimator = mixture(one, EMBEDDINGS[name](one))
    began = process_time()
    estimator.fit(simulated, generator=draw)
    seconds = process_time() - began
    theta, posterior = judged["theta"][:, 0, 0], estimator.each(judged)
    ball = ball_credibility(posterior, theta, one.problem.space, generator=draw)
    return {
        "seconds": seconds,
        "density": float(posterior.log_prob(theta).mean()),
        "prior": float(one.problem.prior.log_prob(theta).mean()),
        "TARP": coverage_error(ball.tolist()),
    }


def tabled(found: dict[tuple[str, str, int], dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    whole = Study()
    some = (study.tasks, study.embeddings, study.seeds) != (whole.tasks, whole.embeddings, whole.seeds)
    table = ResultTable("embeddings", f"make embeddings{' (a part)' if some else ''}", study.seeds)
    for task in study.tasks:
        for name in study.embeddings:
            results = [found[task, name, seed] for seed in study.seeds]
            head = f"{task}, {name}"
            table.add_seeds(f"{head}: density of the truth", [result["density"] for result in results], unit="nats")
            table.add_seeds(f"{head}: TARP error", [result["TARP"] for result in results], most=0.05)
            table.add_seeds(f"{head}: fit, processor time", [result["seconds"] for result in results], unit="s")
        table.add(f"{task}: the prior's density", results[0]["prior"], unit="nats")
    return table


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
