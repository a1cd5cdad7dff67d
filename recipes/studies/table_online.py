"""``make table-online``: the classic rows of the thesis's Table 5.1: what Online BayesSim believes at its end.

    figure = log p_T(true theta)        T outer steps of a recipe, one real trajectory of 50 steps in each

Without sensor noise the motion decides theta completely, so that any figure can be had and the goal is the thesis's;
with 1 % noise there is a right answer, the exact posterior of the same trajectories, which stands beside ours.

    python -m recipes.studies.table_online [--rows CartPole]       -> docs/results/table-online.json
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import Any

from onlinebayes.experiments import Run, Settings, status
from onlinebayes.inference import LikelihoodEstimator, filter_of
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import ResultTable, generator, seed_everything
from onlinebayes.trainers import OnlineState
from recipes import acrobot, cartpole, pendulum
from recipes.studies.jobs import Places, each_kept_or_done, finished, printed_by

SEEDS, NOISES, DRAWS = (1, 2, 3, 4, 5), (0.0, 0.01), 300


@dataclass(frozen=True)
class Row:
    """One row: a recipe, how it is built, its unknown parameters, and the thesis's figure."""

    recipe: ModuleType
    build: Callable[[Settings], Run]
    space: ParameterSpace
    thesis: float


ROWS: dict[str, Row] = {
    "CartPole": Row(cartpole, cartpole.build, cartpole.SPACE, 4.66),
    "Pendulum": Row(pendulum, pendulum.build, pendulum.SPACE, 4.076),
    "Acrobot, masses": Row(acrobot, acrobot.build, acrobot.SPACE, 2.85),
    "Acrobot, lengths": Row(acrobot, partial(acrobot.build, space=acrobot.LENGTHS), acrobot.LENGTHS, 2.25),
}


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    rows: tuple[str, ...] = tuple(ROWS)
    """which rows"""
    noises: tuple[float, ...] = NOISES
    """of the sensors, as a share of each range"""
    seeds: tuple[int, ...] = SEEDS
    """of truths, worlds and networks"""
    out: str = "out/table-online"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    runs = [(row, noise, seed) for seed in study.seeds for row in study.rows for noise in study.noises]
    jobs = {job: partial(ended, *job) for job in runs}
    found = each_kept_or_done("table-online", study.out, jobs, file_of, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def file_of(job: tuple[str, float, int]) -> str:
    """Name of a job's file."""
    return "-".join(map(str, job)).replace(", ", "-")


def ended(name: str, noise: float, seed: int) -> dict[str, Any]:
    """One run of a recipe: log density of the truth under its last belief; with noise, under the exact posterior."""
    seed_everything(seed)
    made = ROWS[name].build(Settings(seed=seed, noise=noise))
    state = made.trainer.run(OnlineState.begin(made.problem.prior))
    found = {
        "ours": float(state.belief.log_prob(made.truth)),
        "prior": float(made.problem.prior.log_prob(made.truth)),
        "return": made.problem.score(made.trainer.objective.policy, made.truth),
    }
    if noise > 0 and state.real is not None:
        makers = made.trainer.makers(state, range(len(state.policies)))
        simulated = made.trainer.simulations.draw(makers, made.problem.prior)
        exact = reference(made, ROWS[name].recipe.state)
        exact.fit(simulated, generator=generator(seed, "exact"))
        posterior = exact.condition(state.real)
        found |= {"exact": float(posterior.log_prob(made.truth)), "effective": float(posterior.effective)}
    return found


def reference(made: Run, state: Callable[..., Any]) -> LikelihoodEstimator:
    """The exact posterior of a recipe's problem."""
    problem = made.problem
    model = filter_of(problem.simulator, problem.task, problem.prior.box, state=state)
    return LikelihoodEstimator(model, problem.prior.box, problem.task.action_spec.shape[-1], draws=DRAWS)


def tabled(found: dict[tuple[str, float, int], dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all runs."""
    table = ResultTable("table-online", printed_by("table-online", study), study.seeds)
    for row in study.rows:
        for noise in study.noises:
            runs, told = [found[row, noise, seed] for seed in study.seeds], f"{row}, noise {100 * noise:g} %"
            ours = [run["ours"] for run in runs]
            table.add_seeds(f"{told}: ours", ours, unit="nats")
            if noise > 0:
                table.add_seeds(f"{told}: exact posterior", [run["exact"] for run in runs], unit="nats")
                table.add_seeds(f"{told}: its effective draws", [run["effective"] for run in runs])
            else:
                middle, goal = statistics.median(ours), f"above {ROWS[row].thesis:g}, the thesis's"
                table.add(f"{told}: median", middle, unit="nats", goal=goal, holds=middle > ROWS[row].thesis)
            table.add_seeds(f"{told}: return on the true system", [run["return"] for run in runs])
        table.add(f"{row}: the prior", runs[0]["prior"], unit="nats")
    return table


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
