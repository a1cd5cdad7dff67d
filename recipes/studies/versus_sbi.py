"""``make versus-sbi``: our estimator beside sbi's NPE on the same simulations, judged by the same held-out thetas.

| part     | what                                                                                              |
|----------|---------------------------------------------------------------------------------------------------|
| systems  | Pendulum, CartPole, Acrobot's masses; trajectories of 50 steps of an untrained policy, no noise       |
| ours     | ``residual_estimator``: the summary and a mixture, trained by ``fit`` as it stands                    |
| theirs   | sbi's MDN, MAF, NSF on our summary, and on the raw trajectory (see ``versus_sbi_peer``)               |
| density  | mean log density of 500 held-out truths; the standard error of a difference is that of its mean over them |
| coverage | mean distance between the level of a highest-density region and the share of truths in it            |
| seconds  | processor time on one thread: ours, theirs, ours again; ours includes the summary, theirs gets it made |

Draws and densities are of one trajectory's posterior, the first one of which sbi has half inside the prior: a million
of each, or a tenth of that for flows, whose time grows with the number. A job is a method on a system, a budget and a
seed, and is kept: a second start goes on.

    python -m recipes.studies.versus_sbi [--tasks pendulum] [--budgets 2000]     -> docs/results/versus-sbi.json
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from types import ModuleType
from typing import Any, TypeVar

import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.experiments import Settings, status
from onlinebayes.inference import NeuralEstimator, fit, residual_estimator
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.runs import BadInput, ResultTable, generator, seed_everything
from recipes import acrobot, cartpole, pendulum
from recipes.studies.exact import coverage_error
from recipes.studies.jobs import Places, check_names, each_kept_or_done, finished, printed_by

TASKS: dict[str, ModuleType] = {"pendulum": pendulum, "cartpole": cartpole, "acrobot": acrobot}
BUDGETS, SEEDS = (200, 2000, 10_000), (1, 2, 3)
OURS = ("mdn", "maf", "nsf")  # on our features
METHODS = (*OURS, *(f"{density} raw" for density in OURS))
STEPS, HELD_OUT, ROUNDS = 50, 500, 3
MILLION = 1_000_000
AHEAD, SIGNIFICANT = 0.3, 2.0
FASTER = {"mdn": {"fit": 3, "draws": 5, "log_prob": 2}}
FASTER |= {flow: {"fit": 3, "draws": 20, "log_prob": 5} for flow in ("maf", "nsf")}
NAMES = {"fit": "fitting", "draws": "1e6 draws", "log_prob": "1e6 log densities"}

Result = dict[str, Any]
T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """which systems"""
    budgets: tuple[int, ...] = BUDGETS
    """numbers of simulations"""
    seeds: tuple[int, ...] = SEEDS
    """of simulations and networks"""
    methods: tuple[str, ...] = METHODS
    """sbi's density, alone for our features, with " raw" behind it for raw trajectories"""
    points: int = MILLION
    """draws and log densities that are timed, a tenth of it for flows; the table is for a million"""
    out: str = "out/versus_sbi"

    def __post_init__(self) -> None:
        check_names(self.tasks, TASKS)
        check_names(self.methods, METHODS)


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    wanted = product(study.tasks, study.budgets, study.seeds, study.methods)
    jobs = {each: partial(compared, *each, study.points) for each in wanted}
    found = each_kept_or_done("versus-sbi", study.out, jobs, lambda each: name_of(*each), study.ray_workers)
    table = tabled(found, ResultTable("versus-sbi", printed_by("versus-sbi", study), study.seeds))
    return finished(table, study.results, found)


def name_of(task: str, budget: int, seed: int, method: str) -> str:
    """Of a job's file."""
    return f"{task}-{budget}-{seed}-{method.replace(' ', '-')}"


def compared(task: str, budget: int, seed: int, method: str, points: int) -> Result:
    """One of sbi's densities beside ours."""
    try:
        from recipes.studies.versus_sbi_peer import LEAKAGE, Each, fitted, raw
    except ImportError:
        raise BadInput("sbi is not installed", "install it: pip install 'onlinebayes[peers]'") from None

    seed_everything(seed)
    made = TASKS[task].build(Settings(seed=seed, noise=0.0))
    problem, policy = made.problem, made.trainer.objective.policy
    simulated = problem.simulations(budget, STEPS, seed).draw([policy], problem.prior)
    held = problem.simulations(HELD_OUT, STEPS, seed + 1000).draw([policy], problem.prior)
    theta = held["theta"][:, 0]

    ours, first = timed(partial(own, task, made, simulated, seed))
    told = raw if method.endswith("raw") else partial(summary, ours)
    x, seen = told(simulated), told(held)
    torch.manual_seed(seed)
    theirs, fitting = timed(partial(fitted, method, problem.space, simulated["theta"][:, 0], x))
    again = timed(partial(own, task, made, simulated, seed))[1]

    each, batch = Each(theirs, seen), ours.each(held.unsqueeze(1))
    result: Result = {
        "density": each.log_prob(theta).tolist(),
        "our density": batch.log_prob(theta).tolist(),
        "coverage": coverage_error(each.credibility(theta).tolist()),
        "our coverage": coverage_error(
            credibility_of(batch, theta, samples=LEAKAGE, generator=generator(seed, "credibility")).tolist()
        ),
        "fit": fitting,
        "our fit": statistics.median([first, again]),
    }
    # sbi may draw without end where nearly all of a density leaks out of the prior.
    k = int((each.inside > 0.5).int().argmax())
    belief, one = ours.condition(held[k : k + 1]), theirs.set_default_x(seen[k : k + 1])
    count = points if method.startswith("mdn") else points // 10

    def draw() -> Tensor:
        return one.sample((count,), show_progress_bars=False)

    def weigh(drawn: Tensor) -> Tensor:
        return one.log_prob(drawn, leakage_correction_params={"num_rejection_samples": LEAKAGE})

    return result | paced(belief.sample, belief.log_prob, draw, weigh, points, count)


def own(task: str, made: Any, simulated: TensorDict, seed: int) -> NeuralEstimator:
    """Ours, fitted."""
    problem = made.problem
    torch.manual_seed(seed)
    build = residual_estimator(problem.simulator, problem.task, state=TASKS[task].state, train=fit)
    estimator = build(problem.prior)
    assert isinstance(estimator, NeuralEstimator)
    estimator.fit(simulated, generator=generator(seed, "versus sbi"))
    return estimator


@torch.no_grad()
def summary(ours: NeuralEstimator, trajectories: TensorDict) -> Tensor:
    """Our features of trajectories (B, T)."""
    return ours.loss.embedding(*ours.loss.keys.read(trajectories, ours.loss.weight)).float()


def paced(
    sample: Callable[[tuple[int, ...]], Tensor],
    log_prob: Callable[[Tensor], Tensor],
    draw: Callable[[], Tensor],
    weigh: Callable[[Tensor], Tensor],
    points: int,
    count: int,
) -> Result:
    """Seconds for a million draws and log densities, ours and theirs in turns, medians."""
    seconds: dict[str, list[float]] = {"our draws": [], "our log_prob": [], "draws": [], "log_prob": []}
    for mine in (True, *(False, True) * ROUNDS):
        made, spent = timed(partial(sample, (points,)) if mine else draw)
        weighed = timed(partial(log_prob if mine else weigh, made))[1]
        of, scale = ("our ", MILLION / points) if mine else ("", MILLION / count)
        seconds[f"{of}draws"].append(scale * spent)
        seconds[f"{of}log_prob"].append(scale * weighed)
    return {name: statistics.median(values) for name, values in seconds.items()}


def timed(work: Callable[[], T]) -> tuple[T, float]:
    """Return the result of some work, and its processor time [s]: what other work takes beside it is not counted."""
    begin = time.process_time()
    result = work()
    return result, time.process_time() - begin


# --- the table -------------------------------------------------------------------------------------------------------


def tabled(jobs: Mapping[tuple[str, int, int, str], Result], table: ResultTable) -> ResultTable:
    """Rows of these jobs: task, budget, seed, method."""
    found: dict[tuple[str, int], dict[str, dict[int, Result]]] = {}
    for (task, budget, seed, method), result in jobs.items():
        found.setdefault((task, budget), {}).setdefault(method, {})[seed] = result
    for task, budget in product(TASKS, BUDGETS):
        if (task, budget) in found:
            by_method = {method: found[task, budget][method] for method in METHODS if method in found[task, budget]}
            add_densities(table, f"{task}, {budget} simulations", budget, by_method)
            add_seconds(table, f"{task}, {budget} simulations", by_method)
    return table


def add_densities(table: ResultTable, name: str, budget: int, by_method: dict[str, dict[int, Result]]) -> None:
    """Log densities of the truth, coverage, and how far ours lies above sbi's best on our features."""
    own_runs = {seed: result for runs in by_method.values() for seed, result in runs.items()}
    mean = statistics.fmean
    table.add_seeds(
        f"{name}: ours, log density of the truth",
        [mean(own_runs[s]["our density"]) for s in sorted(own_runs)],
        unit="nats",
    )
    table.add_seeds(f"{name}: ours, coverage error", [own_runs[s]["our coverage"] for s in sorted(own_runs)])
    for method, runs in by_method.items():
        densities = [mean(runs[seed]["density"]) for seed in sorted(runs)]
        table.add_seeds(f"{name}: sbi {method}, log density of the truth", densities, unit="nats")
        table.add_seeds(f"{name}: sbi {method}, coverage error", [runs[seed]["coverage"] for seed in sorted(runs)])
    rivals = {method: runs for method, runs in by_method.items() if method in OURS}
    if not rivals:
        return
    best = max(rivals, key=lambda method: mean(mean(run["density"]) for run in rivals[method].values()))
    ahead, error = difference(list(rivals[best].values()))
    if budget == 2000:
        goal, holds = f"at least {AHEAD:g}", ahead >= AHEAD
    else:
        goal, holds = f"not below 0 by {SIGNIFICANT:g} standard errors", ahead >= -SIGNIFICANT * error
    told = f"standard error {error:.2g}"
    table.add(f"{name}: ours above sbi {best}", ahead, spread=told, unit="nats", goal=goal, holds=holds)


def difference(runs: list[Result]) -> tuple[float, float]:
    """Mean of our log density less theirs over all held-out truths and seeds, and its standard error."""
    pairs = torch.tensor([run["our density"] for run in runs]) - torch.tensor([run["density"] for run in runs])
    return float(pairs.mean()), float(pairs.std() / pairs.numel() ** 0.5)


def add_seconds(table: ResultTable, name: str, by_method: dict[str, dict[int, Result]]) -> None:
    """Theirs over ours, medians over the seeds."""
    for method, runs in by_method.items():
        for what, words in NAMES.items():
            ours, theirs = (statistics.median(run[f"{of}{what}"] for run in runs.values()) for of in ("our ", ""))
            least = FASTER.get(method, {}).get(what)
            ratio = statistics.median(run[what] / run[f"our {what}"] for run in runs.values())
            goal, holds = (f"at least {least}", ratio >= least) if least else (None, None)
            told = f"{theirs:.3g} s over {ours:.3g} s"
            table.add(f"{name}: {words}, sbi {method} over ours", ratio, spread=told, goal=goal, holds=holds)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
