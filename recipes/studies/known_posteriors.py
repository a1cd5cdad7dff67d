"""``make known-posteriors``: our posteriors and sbi's beside exact ones, by a classifier that tries to tell them apart.

    C2ST = accuracy of a classifier between draws of the estimate and of the exact posterior: 1/2 where they are equal

10,000 simulations, five measurements of each task, 1000 draws of each posterior; a mixture and a spline flow of ours;
mixture, MAF and NSF of sbi as it comes (Lopez-Paz and Oquab 2017; Lueckmann et al. 2021).

    python -m recipes.studies.known_posteriors [--tasks edge]       -> docs/results/known-posteriors.json
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.experiments import status
from onlinebayes.inference import (
    BoxUniform,
    FlowEstimator,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    fit,
)
from onlinebayes.runs import ResultTable
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by
from recipes.studies.known_tasks import TASKS, KnownTask
from recipes.studies.one_round import begun

SIMULATIONS, MEASUREMENTS, DRAWS, SEED, SAME = 10_000, 5, 1000, 561, 0.55
GAUSSIAN = ("linear Gaussian, 2", "linear Gaussian, 10")

Sampler = Callable[[Float[Tensor, " D"], int], Float[Tensor, "N P"]]
"""(x, number) -> draws of the estimated posterior."""


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """which tasks"""
    out: str = "out/known-posteriors"


def as_trajectories(x: Float[Tensor, "N D"], theta: Float[Tensor, "N P"] | None = None) -> TensorDict:
    """Each x as the one step of a trajectory that begins at zero."""
    x = x.float()[:, None]
    told = {"observation": torch.zeros_like(x), "action": torch.zeros_like(x[..., :1]), "next": {"observation": x}}
    if theta is not None:
        told["theta"] = theta[:, None]
    return TensorDict(told, batch_size=x.shape[:2])


def ours(kind: str, task: KnownTask, theta: Tensor, x: Tensor, generator: torch.Generator) -> Sampler:
    """A mixture or a spline flow of ours."""
    embedding = SummaryEmbedding(TransitionFeatures(x.shape[1], 1, products=False))
    network: MixtureEstimator | FlowEstimator
    if kind == "flow":
        network, train = FlowEstimator(task.space, embedding.size), partial(fit, learning_rate=3e-3)
    else:
        network, train = MixtureEstimator(task.space, embedding.size, components=10), partial(fit)
    estimator = NeuralEstimator(NeuralPosteriorLoss(embedding, network), train)
    estimator.fit(as_trajectories(x, theta), generator=generator)
    return lambda x, number: estimator.condition(as_trajectories(x[None])).sample((number,), generator)


def theirs(kind: str, task: KnownTask, theta: Tensor, x: Tensor, _: torch.Generator) -> Sampler:
    """sbi's, with its own defaults."""
    from sbi.inference import NPE
    from sbi.utils import BoxUniform as Uniform

    prior = Uniform(task.space.low.float(), task.space.high.float())
    inference = NPE(prior, density_estimator=kind, show_progress_bars=False)
    inference.append_simulations(theta.float(), x.float()).train(training_batch_size=200)
    posterior = inference.build_posterior()
    return lambda x, number: posterior.sample((number,), x=x.float(), show_progress_bars=False)


METHODS: dict[str, Callable[[KnownTask, Tensor, Tensor, torch.Generator], Sampler]] = {
    "mixture": partial(ours, "mixture"),
    "spline flow": partial(ours, "flow"),
    "sbi's mixture": partial(theirs, "mdn"),
    "sbi's MAF": partial(theirs, "maf"),
    "sbi's NSF": partial(theirs, "nsf"),
}


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs = {(task, method): partial(told_apart, task, method) for task in study.tasks for method in METHODS}
    found = each_kept_or_done("known-posteriors", study.out, jobs, file_of, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def file_of(key: tuple[str, str]) -> str:
    """Name of a job's file."""
    return ", ".join(key).replace(" ", "_")


def told_apart(name: str, method: str) -> dict[str, Any]:
    """C2ST of each measurement."""
    from sbi.utils.metrics import c2st

    task, draw = TASKS[name], begun(SEED)
    theta = BoxUniform(task.space).sample((SIMULATIONS,), draw)
    x = task.simulate(theta, draw)
    prior = BoxUniform(task.space).sample((MEASUREMENTS,), draw)
    truth = prior if task.truth is None else torch.tensor(task.truth).double().expand(MEASUREMENTS, -1)
    measured = task.simulate(truth, draw)
    sampler = METHODS[method](task, theta, x, draw)
    found = []
    for one in measured:
        exact, estimated = task.draw(one, DRAWS, draw), sampler(one, DRAWS)
        found.append(float(c2st(exact.float(), estimated.float())))
    return {"C2ST": found}


def tabled(found: dict[tuple[str, str], dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all tasks."""
    table = ResultTable("known-posteriors", printed_by("known-posteriors", study), [SEED])
    for task in study.tasks:
        means = {method: statistics.fmean(found[task, method]["C2ST"]) for method in METHODS}
        for method, mean in means.items():
            each = " ".join(f"{value:.3f}" for value in found[task, method]["C2ST"])
            table.add(f"{task}, {method}: C2ST", mean, spread=each)
        best = min(means["mixture"], means["spline flow"])
        limit = SAME if task in GAUSSIAN else min(value for method, value in means.items() if method.startswith("sbi"))
        goal = f"at most {limit:.3g}{'' if task in GAUSSIAN else ', the best of sbi'}"
        table.add(f"{task}: the better of ours", best, goal=goal, holds=best <= limit)
    return table


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
