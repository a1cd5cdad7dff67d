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
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Literal, get_args

from tensordict import TensorDictBase

from onlinebayes.inference.calibration import ball_credibility
from onlinebayes.runs import ResultTable, generator, seed_everything
from onlinebayes.trainers import OnlineState, Problem
from recipes import hopper
from recipes.common import Kind, Run, status
from recipes.hopper import Engine, Settings
from recipes.studies import known_start
from recipes.studies.exact import coverage_error
from recipes.studies.finished_run import finished_run
from recipes.studies.resumable import asked, each_kept_or_done

Part = Literal["policies", "friction"]
Key = tuple[Any, ...]
LOWS, SEEDS = (0.3, 0.1), (1, 2, 3)
ENGINES: tuple[Engine, ...] = get_args(Engine)
KINDS: tuple[Kind, ...] = ("prior", "online")
STEPS, RUN_UP, SIMULATIONS, THETAS, KNOWN, EPISODES, EPOCHS = 50, 125, 10_000, 300, 100, 32, 25
WINDOWS = {"starting": 0, "running": RUN_UP}
RETURN, DENSITY = 2400.0, 4.0


@dataclass(frozen=True)
class Study:
    """What to run."""

    parts: tuple[Part, ...] = get_args(Part)
    """which parts"""
    lows: tuple[float, ...] = LOWS
    """least friction of the prior"""
    seeds: tuple[int, ...] = SEEDS
    """of truths, worlds and networks"""
    out: str = "out/hopper"
    """runs and finished jobs go here"""
    results: Path = Path("docs/results")
    """folder of the table"""
    ray_workers: int = 0
    """do the jobs on so many workers of Ray"""


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    each = list(product(study.lows, study.seeds))
    kinds = KINDS if "policies" in study.parts else ("online",)  # whose policy the friction is told by
    learn = {
        ("policy", low, kind, seed): partial(ended, study.out, low, kind, seed) for low, seed in each for kind in kinds
    }
    found = done(study, learn)
    if "friction" in study.parts:
        found |= done(
            study,
            {("friction", low, e, seed): partial(told, study.out, low, e, seed) for low, seed in each for e in ENGINES},
        )
    table = tabled(found, study)
    print(table.to_markdown())
    print(f"written: {table.write(study.results)}")
    return 0 if table.holds else 1


def done(study: Study, jobs: Mapping[Key, Callable[[], dict[str, Any]]]) -> dict[Key, dict[str, Any]]:
    """What jobs give, of which none asks for what another does."""
    return each_kept_or_done("hopper", study.out, jobs, lambda key: "-".join(map(str, key)), study.ray_workers)


def trained(out: str, low: float, kind: Kind, seed: int) -> tuple[Run, OnlineState]:
    """A run of the recipe, done first where it is missing.

    Raises:
        BadInput: it was stopped.
    """
    return finished_run("hopper", hopper.build, Settings(seed=seed, kind=kind, low=low, out=f"{out}/low-{low:g}"))


def engine(made: Run, low: float, real: Engine) -> Problem:
    """The task in an engine, behind the same sensors."""
    problem = made.problem
    return Problem(hopper.engine_of(real, hopper.space_of(low)), problem.task, problem.prior, problem.sensor_sd)


def ended(out: str, low: float, kind: Kind, seed: int) -> dict[str, Any]:
    """Returns of a policy in both engines at the truth; what its run believes."""
    made, state = trained(out, low, kind, seed)
    policy = made.trainer.objective.policy
    scores = {str(e): engine(made, low, e).score(policy, made.truth, episodes=EPISODES) for e in ENGINES}
    return {**scores, "density": float(state.belief.log_prob(made.truth)), "frames": state.frames}


def told(out: str, low: float, real: Engine, seed: int) -> dict[str, Any]:
    """Log densities of many truths from one trajectory each in an engine, the estimator trained in MuJoCo."""
    made, _ = trained(out, low, "online", seed)
    seed_everything(seed)
    policy, prior = made.trainer.objective.policy, made.problem.prior
    simulated = made.problem.simulations(SIMULATIONS, RUN_UP + STEPS, seed + 1).draw([policy], prior)
    judged = engine(made, low, real).simulations(THETAS, RUN_UP + STEPS, seed + 2).draw([policy], prior)
    result: dict[str, Any] = {"prior": float(prior.log_prob(judged["theta"][0, 0]))}
    for name, begin in WINDOWS.items():
        some, those = window(simulated, begin), window(judged, begin)
        estimator = hopper.estimator(EPOCHS, prior)
        estimator.fit(some, generator=generator(seed, "hopper"))
        theta, posterior = those["theta"][:, 0], estimator.each(those.unsqueeze(1))
        ball = ball_credibility(posterior, theta, made.problem.space, generator=generator(seed, "ball"))
        density = posterior.log_prob(theta)
        result[name] = {
            "density": float(density.mean()),
            "median": float(density.median()),
            "TARP": coverage_error(ball.tolist()),
            "kept": len(those),
        }
        if real == "mujoco":
            most = known_start.densities(engine(made, low, real), policy, KNOWN, begin, STEPS, seed + 3)
            result[name]["most"] = float(most.mean())
    return result


def window(data: TensorDictBase, begin: int) -> TensorDictBase:
    """The steps from ``begin`` on, of trajectories that last."""
    some = data[:, begin : begin + STEPS]
    return some[some["mask"].all(1)]


def tabled(found: dict[Key, dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    table = ResultTable("hopper", asked("hopper", study), study.seeds)
    for low in study.lows:
        head = f"prior U[{low:g}, {hopper.HIGH:g}]"
        if "policies" in study.parts:
            add_policies(table, head, {kind: [found["policy", low, kind, s] for s in study.seeds] for kind in KINDS})
        if "friction" in study.parts:
            told = {real: [found["friction", low, real, s] for s in study.seeds] for real in ENGINES}
            table.add(f"{head}: the prior's density", told[ENGINES[0]][0]["prior"], unit="nats")
            for real, results in told.items():
                add_friction(table, head, real, results)
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
    """Rows of the friction from trajectories of one engine."""
    for name in WINDOWS:
        words = f"{head}, {name}, measured in {'Drake' if real == 'drake' else 'MuJoCo'}"
        least = DENSITY if name == "running" else None
        parts = [r[name] for r in results]
        table.add_seeds(f"{words}: log density of the truth", [p["density"] for p in parts], unit="nats", least=least)
        if real == "mujoco":
            table.add_seeds(f"{words}: exact, its start known", [p["most"] for p in parts], unit="nats")
        middle = statistics.median(p["median"] for p in parts)
        table.add(f"{words}: median over thetas", middle, unit="nats")
        table.add_seeds(f"{words}: TARP error", [p["TARP"] for p in parts], most=0.05)
        table.add_seeds(f"{words}: trajectories that last, of {THETAS}", [p["kept"] for p in parts])


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
