"""``make calibration-one-by-one``: is the posterior of a sampler that needs a run for each measurement calibrated?

Truncated rounds, epsilon-free and population ABC, on one trajectory of each of 100 thetas, noise 1 %. TARP error as in
``make calibration``; for an exact posterior it is .03 with 100 thetas. Each finished job is kept.

    python -m recipes.studies.one_by_one [--tasks pendulum]       -> docs/results/calibration-one-by-one.json
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import SimulatorReference, SummaryEmbedding, TransitionFeatures
from onlinebayes.experiments import status
from onlinebayes.inference import Belief, BoxUniform, Density, EpsilonFree, PopulationABC, proposals
from onlinebayes.inference.calibration import ball_credibility, credibility_of
from onlinebayes.inference.neural import mixture_of
from onlinebayes.inference.population import Simulate
from onlinebayes.runs import ResultTable
from onlinebayes.trainers import Listed
from recipes.studies.calibration import NOISE, SEED, add_cell
from recipes.studies.one_round import TRAIN, OneRound, begun
from recipes.studies.resumable import each_kept_or_done

THETAS, ROUND, BATCH, BUDGET = 100, 300, 1000, 20_000

Sampler = Callable[[TensorDictBase, torch.Generator], Density]
"""(trajectories (1, T), generator) -> posterior."""


def simulate_by(one: OneRound, number: int, which: int) -> Simulate:
    """Trajectories of given parameters, always so many at once."""
    worlds = one.worlds(number, which)

    def simulate(theta: Float[Tensor, "B P"], _: torch.Generator) -> TensorDict:
        return worlds.draw([one.policy], Listed(theta))

    return simulate


def summary(one: OneRound, proposal: Belief) -> SummaryEmbedding:
    """The least-squares summary about the centre of a proposal."""
    simulator, task = one.problem.simulator, one.problem.task
    reference = SimulatorReference(
        simulator, proposal.box.cross(), state=one.state, command=task.command, observe=task.observe
    )
    return SummaryEmbedding(
        TransitionFeatures(
            task.observation_size,
            task.action_spec.shape[-1],
            reference=reference,
            sensitivities=len(simulator.parameters),
        )
    )


def truncated_rounds(one: OneRound) -> Sampler:
    """A first round that all share, then one in the region that the first leaves in question."""
    prior, worlds, draw = one.problem.prior, one.worlds(ROUND, 11), begun(one.seed)
    first = mixture_of(summary(one, prior), prior, TRAIN)
    first.fit(worlds.draw([one.policy], prior), generator=draw)

    def sample(measured: TensorDictBase, generator: torch.Generator) -> Density:
        proposal = proposals.truncated(first.condition(measured).distribution, generator=generator)
        second = mixture_of(summary(one, proposal), proposal, TRAIN)
        second.fit(worlds.draw([one.policy], proposal), generator=generator)
        return second.condition(measured).distribution

    return sample


def epsilon_free(one: OneRound) -> Sampler:
    """Gaussian rounds."""
    sampler = EpsilonFree(
        lambda proposal: summary(one, proposal),
        BoxUniform(one.problem.space),
        simulate_by(one, ROUND, 12),
        rounds=2,
        simulations=ROUND,
        train=TRAIN,
    )
    return lambda measured, generator: sampler.run(measured, generator).belief


def population(one: OneRound) -> Sampler:
    """A cloud that moves."""
    prior = BoxUniform(one.problem.space)
    sampler = PopulationABC(summary(one, prior), prior, simulate_by(one, BATCH, 13), batch=BATCH, simulations=BUDGET)
    return lambda measured, generator: sampler.run(measured, generator).belief


SAMPLERS: dict[str, Callable[[OneRound], Sampler]] = {
    "truncated rounds": truncated_rounds,
    "epsilon-free": epsilon_free,
    "population ABC": population,
}


TASKS = ("pendulum", "cartpole")


@dataclass(frozen=True)
class Study:
    """What to judge."""

    tasks: tuple[str, ...] = TASKS
    """which recipes"""
    out: str = "out/one_by_one"
    """finished jobs go here"""
    results: Path = Path("docs/results")
    """folder of the table"""
    ray_workers: int = 0
    """workers on Ray that do the jobs; 0: this process does, one after the other"""


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs = {(task, name): partial(sampled, task, name, SEED, NOISE) for task in study.tasks for name in SAMPLERS}
    label = "calibration-one-by-one"
    found = each_kept_or_done(label, study.out, jobs, lambda job: ", ".join(job).replace(" ", "_"), study.ray_workers)
    some = " (a part)" if study.tasks != TASKS else ""
    table = ResultTable(label, f"make {label}{some}", [SEED], commit=found.commit)
    for (task, name), result in found.items():
        add_cell(table, f"{task}, {name}", 1, result)
        table.add(f"{task}, {name}: processor time of a run", result["seconds"], unit="s")
    print(table.to_markdown())
    print(f"written: {table.write(study.results)}")
    return 0 if table.holds else 1


def sampled(task: str, name: str, seed: int, noise: float, thetas: int = THETAS) -> dict[str, Any]:
    """One sampler on one system: the log densities and both credibilities of all truths, n = 1."""
    draw = begun(seed)
    one = OneRound.of(task, seed, noise)
    judged = one.simulated(thetas, 14)
    sampler = SAMPLERS[name](one)
    began = process_time()
    result: dict[str, Any] = {"density 1": [], "region 1": [], "ball 1": []}
    for i in range(thetas):
        theta = judged["theta"][i, 0]
        posterior = sampler(judged[i : i + 1].exclude("theta"), draw)
        result["density 1"].append(float(posterior.log_prob(theta)))
        alone = _One(posterior)
        result["region 1"].append(float(credibility_of(alone, theta[None], generator=draw)))
        ball = ball_credibility(alone, theta[None], one.problem.space, generator=draw)
        result["ball 1"].append(float(ball))
    result["seconds"] = (process_time() - began) / thetas
    return result


class _One:
    """A single posterior as a batch of one."""

    def __init__(self, posterior: Density) -> None:
        self._posterior = posterior

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draws (*shape, 1, P)."""
        return self._posterior.sample(shape, generator).unsqueeze(-2)

    def log_prob(self, theta: Float[Tensor, "*batch P"]) -> Tensor:
        """Of theta (..., 1, P)."""
        return self._posterior.log_prob(theta)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
