"""``make hopper``: a hopper learnt in MuJoCo and judged in Drake, and what its gait tells of the ground's friction.

| part     | what is measured                                                                                  |
|----------|---------------------------------------------------------------------------------------------------|
| policies | return over 1000 steps in Drake and in MuJoCo of policies trained on the prior's worlds and online, |
|          | prior U[.3, .5] and U[.1, .5]; what the online run believes of Drake's friction                     |
| friction | log density of the truth from one trajectory of a trained policy, noise 1 cm: 300 thetas simulated  |
|          | in MuJoCo and in Drake, with an estimator trained in MuJoCo; in MuJoCo beside the exact posterior of |
|          | one who knows the state in which the trajectory begins, the most that the data can tell             |

A trajectory of 50 steps begins after a second of running (``running``) or where the hopper stands (``starting``).
Each finished job and each run of the recipe is kept, so that a second start goes on.

    python -m recipes.studies.hopper [--parts friction] [--seeds 1]       -> docs/results/hopper.json
    make hopper-policies: --parts policies --lows .3                      -> docs/results/hopper-policies.json
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, Literal, get_args

from tensordict import TensorDictBase

from onlinebayes.experiments import Kind, Run, status
from onlinebayes.inference import PosteriorEstimator
from onlinebayes.inference.calibration import ball_credibility
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import ResultTable, generator, seed_everything
from onlinebayes.trainers import Listed, OnlineState, Problem
from recipes import hopper
from recipes.hopper import Engine, Settings
from recipes.studies import known_start
from recipes.studies.exact import coverage_error
from recipes.studies.finished_run import finished_run
from recipes.studies.jobs import Found, Places, each_kept_or_done, finished, printed_by

Part = Literal["policies", "friction"]
Key = tuple[Any, ...]
LOWS, SEEDS = (0.3, 0.1), (1, 2, 3)
ENGINES: tuple[Engine, ...] = get_args(Engine)
KINDS: tuple[Kind, ...] = ("prior", "online")
STEPS, RUN_UP, SIMULATIONS, THETAS, KNOWN, EPISODES, EPOCHS = 50, 125, 10_000, 300, 100, 32, 25
WINDOWS = {"starting": 0, "running": RUN_UP}
RETURN, NEAR = 2400.0, 0.3


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    parts: tuple[Part, ...] = get_args(Part)
    """which parts"""
    lows: tuple[float, ...] = LOWS
    """least friction of the prior"""
    seeds: tuple[int, ...] = SEEDS
    """of truths, worlds and networks"""
    out: str = "out/hopper"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    each, parts = list(product(study.lows, study.seeds)), list[Found[Key]]()
    if "policies" in study.parts:
        jobs = {("policy", *key, kind): partial(ended, study.out, *key, kind) for key in each for kind in KINDS}
        parts.append(done(study, jobs))
    if "friction" in study.parts:  # by the policies, which are there by now
        parts.append(done(study, {("friction", *key): partial(told, study.out, *key) for key in each}))
    table = tabled({key: result for part in parts for key, result in part.items()}, study)
    table.commit = ", ".join(sorted({part.commit for part in parts}))
    return finished(table, study.results)


def done(study: Study, jobs: Mapping[Key, Callable[[], dict[str, Any]]]) -> Found[Key]:
    """Return the results of jobs, of which none asks for what another does."""
    return each_kept_or_done("hopper", study.out, jobs, lambda key: "-".join(map(str, key)), study.ray_workers)


def trained(out: str, low: float, seed: int, kind: Kind) -> tuple[Run, OnlineState]:
    """A run of the recipe, done first where it is missing.

    Raises:
        BadInput: it was stopped.
    """
    return finished_run("hopper", hopper.build, Settings(seed=seed, kind=kind, low=low, out=f"{out}/low-{low:g}"))


def engine(made: Run, low: float, real: Engine) -> Problem:
    """The task in an engine, behind the same sensors."""
    problem = made.problem
    return Problem(hopper.engine_of(real, hopper.space_of(low)), problem.task, problem.prior, problem.sensor_sd)


def ended(out: str, low: float, seed: int, kind: Kind) -> dict[str, Any]:
    """Returns of a policy in both engines at the truth; what its run believes."""
    made, state = trained(out, low, seed, kind)
    policy = made.trainer.objective.policy
    scores = {str(e): engine(made, low, e).score(policy, made.truth, episodes=EPISODES) for e in ENGINES}
    return {**scores, "density": float(state.belief.log_prob(made.truth)), "frames": state.frames}


def told(out: str, low: float, seed: int) -> dict[str, Any]:
    """Judge inference from one trajectory in either engine, by estimators trained in MuJoCo; the prior's density."""
    made, _ = trained(out, low, seed, "online")
    seed_everything(seed)
    policy, prior = made.trainer.objective.policy, made.problem.prior
    simulated = made.problem.simulations(SIMULATIONS, RUN_UP + STEPS, seed + 1).draw([policy], prior)
    truths = Listed(prior.sample((THETAS,)))
    judged = {
        e: engine(made, low, e).simulations(THETAS, RUN_UP + STEPS, seed + 2).draw([policy], truths) for e in ENGINES
    }
    result: dict[str, Any] = {"prior": float(prior.log_prob(judged["mujoco"]["theta"][0, 0]))}
    for name, begin in WINDOWS.items():
        estimator = hopper.estimator(EPOCHS, prior)
        estimator.fit(window(simulated, begin), generator=generator(seed, "hopper"))
        result[name] = {
            e: judgement(estimator, window(data, begin), made.problem.space, seed) for e, data in judged.items()
        }
        most = known_start.densities(engine(made, low, "mujoco"), policy, KNOWN, begin, STEPS, seed + 3)
        result[name]["mujoco"]["most"] = float(most.mean())
    return result


def judgement(
    estimator: PosteriorEstimator, some: TensorDictBase, space: ParameterSpace, seed: int
) -> dict[str, float]:
    """Densities and calibration of the posteriors of single trajectories."""
    theta, posterior = some["theta"][:, 0], estimator.each(some.unsqueeze(1))
    ball = ball_credibility(posterior, theta, space, generator=generator(seed, "ball"))
    density = posterior.log_prob(theta)
    return {
        "density": float(density.mean()),
        "median": float(density.median()),
        "TARP": coverage_error(ball.tolist()),
        "kept": len(some),
    }


def window(data: TensorDictBase, begin: int) -> TensorDictBase:
    """The steps from ``begin`` on, of trajectories that last."""
    some = data[:, begin : begin + STEPS]
    return some[some["mask"].all(1)]


def tabled(found: dict[Key, dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    name = "hopper-policies" if study.parts == ("policies",) else "hopper"
    whole = name == "hopper-policies" and study.lows == LOWS[:1] and study.seeds == SEEDS
    table = ResultTable(name, f"make {name}" if whole else printed_by(name, study), study.seeds)
    for low in study.lows:
        head = f"prior U[{low:g}, {hopper.HIGH:g}]"
        if "policies" in study.parts:
            add_policies(table, head, {kind: [found["policy", low, s, kind] for s in study.seeds] for kind in KINDS})
        if "friction" in study.parts:
            jobs = [found["friction", low, s] for s in study.seeds]
            table.add(f"{head}: the prior's density", jobs[0]["prior"], unit="nats")
            for real, name in product(ENGINES, WINDOWS):
                add_friction(table, f"{head}, {name}", real, [job[name][real] for job in jobs])
    return table


def add_policies(table: ResultTable, head: str, runs: dict[Kind, list[dict[str, Any]]]) -> None:
    """Rows of the policies of one prior."""
    for kind, results in runs.items():
        least = RETURN if kind == "online" else None
        table.add_seeds(f"{head}, {kind}: return in Drake", [r["drake"] for r in results], least=least)
        table.add_seeds(f"{head}, {kind}: return in MuJoCo", [r["mujoco"] for r in results])
    gain = [b["drake"] - a["drake"] for a, b in zip(runs["prior"], runs["online"], strict=True)]
    table.add_seeds(f"{head}: online above prior, in Drake", gain, least=0.0)
    table.add_seeds(f"{head}, online: log density of Drake's friction", [r["density"] for r in runs["online"]])
    table.add(f"{head}: frames of each run", runs["online"][0]["frames"], unit="frames")


def add_friction(table: ResultTable, head: str, real: Engine, results: list[dict[str, Any]]) -> None:
    """Rows of the friction from one window of an engine's trajectories."""
    words = f"{head}, measured in {'Drake' if real == 'drake' else 'MuJoCo'}"
    table.add_seeds(f"{words}: log density of the truth", [r["density"] for r in results], unit="nats")
    if real == "mujoco":
        table.add_seeds(f"{words}: exact, its start known", [r["most"] for r in results], unit="nats")
        short = statistics.median(r["most"] - r["density"] for r in results)
        told, goal = f"{words}: below the exact one", f"at most {NEAR:g}"
        table.add(told, short, unit="nats", goal=goal, holds=short <= NEAR)
    table.add(f"{words}: median over thetas", statistics.median(r["median"] for r in results), unit="nats")
    table.add_seeds(f"{words}: TARP error", [r["TARP"] for r in results], most=0.05)
    table.add_seeds(f"{words}: trajectories that last, of {THETAS}", [r["kept"] for r in results])


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
