"""``make planner``: what the planner reaches with a belief beside the truth, what its settings do, and how fast it is.

| part      | what                                                                                                   |
|-----------|--------------------------------------------------------------------------------------------------------|
| swing-ups | three machines of ``recipes/swing_up.py``, three hidden truths each: mean cost of an episode from 16 starts (MuJoCo: 6) with the prior, the posterior of 50 steps (MuJoCo: a plausible belief), the truth, and the truth once more with other draws of the planner |
| samples   | cart-pole at its truth: effective candidates of 128 by noise and temperature                            |
| risk      | cart-poles whose length and mass are correlated in the belief: costs over eight of them, by risk        |
| speed     | processor time of one plan on the skid-steered robot, in turns with TorchRL's ``MPPIPlanner``           |

Sized for some minutes of one core. Each finished job is kept, so that a second start goes on.

    python -m recipes.studies.planner [--parts speed]       -> docs/results/planner.json
"""  # noqa: E501

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Generator, Tensor

from envs.skid_steer import CircleTask, SkidSteerKinematics
from onlinebayes.control import MPPI, Bounds, Coloured, CVaR, Knots, Mean, Noise, Risk, Unscented, White, WorstCase
from onlinebayes.experiments import hidden_truth, status
from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import ResultTable, seed_everything
from onlinebayes.trainers import Listed, Point
from onlinebayes.trainers.trajectories import returns
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.jobs import each_kept_or_done, finished, printed_by
from recipes.studies.planner_peer import torchrl_planner
from recipes.swing_up import NEAR, SYSTEMS, Name, belief_of, cost_of, planner_of, problem_of

Part = Literal["swing-ups", "samples", "risk", "speed"]
SEEDS, NOISE, STARTS = (2, 3, 5), 0.005, {"cartpole": 16, "pendulum": 16, "mujoco": 6}
NOISES: dict[str, Callable[[float], Noise]] = {"white": White, "knots": Knots, "coloured": Coloured}
TEMPERATURES = (0.1, 1.0, 10.0)
TURNS, LEAST_HZ, LEAST_RATIO = 15, 50.0, 20.0
CIRCLE = ParameterSpace(
    {
        "radius": Parameter(0.02, 0.2, "m"),
        "axial_distance": Parameter(0.2, 1.0, "m"),
        "x_icr": Parameter(-0.5, 0.5, "m"),
    }
)


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    parts: tuple[Part, ...] = ("swing-ups", "samples", "risk", "speed")
    """which"""
    seeds: tuple[int, ...] = SEEDS
    """hidden truths of the swing-ups"""
    out: str = "out/planner"
    """finished jobs go here"""
    results: Path = Path("docs/results")
    """folder of the table"""


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs: dict[str, Callable[[], dict[str, Any]]] = {}
    if "swing-ups" in study.parts:
        jobs |= {f"{name}-{seed}": partial(swing_up, name, seed) for seed in study.seeds for name in SYSTEMS}
    if "risk" in study.parts:
        jobs |= {f"risk {name}": partial(risk, name) for name in RISKS}
    if "samples" in study.parts:
        jobs |= {f"{noise}-{heat:g}": partial(samples, noise, heat) for noise in NOISES for heat in TEMPERATURES}
    if "speed" in study.parts:
        jobs["speed"] = speed
    found = each_kept_or_done("planner", study.out, jobs, str)
    table = ResultTable("planner", printed_by("planner", study), study.seeds)
    add_swing_ups(table, found, study.seeds)
    add_samples(table, found)
    add_risk(table, found)
    add_speed(table, found)
    return finished(table, study.results, found)


# --- swing-ups ------------------------------------------------------------------------------------------------------


def swing_up(name: Name, seed: int) -> dict[str, Any]:
    """Mean cost of an episode with the prior, with the posterior and with the truth, from the same starts."""
    seed_everything(seed)
    system = SYSTEMS[name]
    truth, planner = hidden_truth(system.space, seed, system.default), planner_of(system, seed)
    problem = problem_of(system, planner, NOISE)
    cost = partial(cost_of, problem, planner, truth, STARTS[name], seed + 2)
    planner.set_belief(problem.prior)
    blind = float(cost().mean())
    posterior = belief_of(problem, system, planner, truth, 50, seed + 1)
    planner.set_belief(posterior)
    learnt = float(cost().mean())
    planner.set_belief(Point(truth))
    best = float(cost().mean())
    planner = planner_of(system, seed + 1)
    planner.set_belief(Point(truth))
    return {
        "prior": blind,
        "posterior": learnt,
        "truth": best,
        "truth again": float(cost_of(problem, planner, truth, STARTS[name], seed + 2).mean()),
        "gain": float(posterior.log_prob(truth) - problem.prior.log_prob(truth)),
    }


def add_swing_ups(table: ResultTable, found: dict[str, dict[str, Any]], seeds: tuple[int, ...]) -> None:
    """Costs, and the posterior's in parts of the truth's."""
    for name in SYSTEMS:
        runs = [found[key] for seed in seeds if (key := f"{name}-{seed}") in found]
        if not runs:
            continue
        for who in ("prior", "posterior", "truth"):
            table.add_seeds(f"{name}: cost with the {who}", [run[who] for run in runs])
        table.add_seeds(
            f"{name}: cost with the posterior / with the truth",
            [run["posterior"] / run["truth"] for run in runs],
            unit="times",
            most=NEAR,
        )
        table.add_seeds(
            f"{name}: the same of the truth with other draws, which is what chance does",
            [run["truth again"] / run["truth"] for run in runs],
            unit="times",
        )
        table.add_seeds(
            f"{name}: gain of the posterior over the prior at the truth", [r["gain"] for r in runs], unit="nats"
        )


# --- candidates that count ------------------------------------------------------------------------------------------


def samples(noise: str, temperature: float) -> dict[str, Any]:
    """Median effective number of 128 candidates along two swing-ups at the truth, and their mean cost."""
    seed_everything(0)
    system = SYSTEMS["cartpole"]
    truth = hidden_truth(system.space, 0, system.default)
    planner = changed(planner_of(system, 0), noise=NOISES[noise](system.sd), temperature=temperature)
    planner.thetas = 1
    planner.set_belief(Point(truth))
    problem = problem_of(system, planner, 0.0)
    watched = Watched(planner)
    env = problem.worlds(2, ParameterRandomization(Point(truth)), 7)
    cost = -float(returns(env, watched, problem.task.horizon).mean())
    return {"effective": statistics.median(watched.effective), "cost": cost}


def add_samples(table: ResultTable, found: dict[str, dict[str, Any]]) -> None:
    """Effective candidates and costs."""
    for noise in NOISES:
        for heat in TEMPERATURES:
            if (run := found.get(f"{noise}-{heat:g}")) is not None:
                cost = f"cost {run['cost']:.1f}"
                table.add(
                    f"{noise} noise, temperature {heat:g}: candidates of 128 that count", run["effective"], spread=cost
                )


def changed(planner: MPPI, **settings: Any) -> MPPI:
    """The planner with another search."""
    planner.search = replace(planner.search, **settings)
    return planner


class Watched(TensorDictModuleBase):
    """A planner whose reports are kept."""

    def __init__(self, planner: MPPI) -> None:
        self.in_keys, self.out_keys = planner.in_keys, planner.out_keys
        super().__init__()
        self.planner = planner
        self.effective: list[float] = []

    def forward(self, tensordict: TensorDict) -> TensorDict:
        """See :class:`MPPI`."""
        self.planner(tensordict)
        assert self.planner.report is not None
        self.effective += self.planner.report.effective.tolist()
        return tensordict


# --- risk -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class UpperFactor(Unscented):
    """DISCO's published points, beside the right ones: columns of the upper factor."""

    def points(self, mean: Tensor, covariance: Tensor) -> tuple[Tensor, Tensor]:
        """See :class:`Unscented`."""
        points, weights = super().points(mean, covariance)
        size, spread = len(mean), len(mean) + self.kappa
        columns = spread**0.5 * torch.linalg.cholesky(covariance)
        points = torch.cat((points[:1], points[:1] + columns, points[:1] - columns))
        return points[: 2 * size + 1], weights


class Correlated:
    """Cart-poles whose length and mass are known together better than apart (correlation -.9)."""

    mean = torch.tensor((0.6, 0.25), dtype=torch.float64)
    factor = torch.tensor(((0.1, 0.0), (-0.072, 0.035)), dtype=torch.float64)

    def sample(self, shape: tuple[int, ...]) -> Tensor:
        """Within two standard deviations, and so within the bounds."""
        z = torch.randn(*shape, 2, dtype=torch.float64).clamp(-2, 2)
        return self.mean + z @ self.factor.T


class AtTheMean(Mean):
    """No risk, no belief: its mean alone."""

    def worlds(self, draws: Tensor, number: int, generator: Generator) -> tuple[Tensor, Tensor]:
        """See :class:`Risk`."""
        return draws.mean(0, keepdim=True), torch.ones(1).to(draws)


RISKS: dict[str, Risk] = {
    "mean": Mean(),
    "CVaR .25": CVaR(0.25),
    "worst case": WorstCase(),
    "unscented": Unscented(),
    "unscented, upper factor": UpperFactor(),
    "the belief's mean alone": AtTheMean(),
}


def risk(name: str) -> dict[str, Any]:
    """Costs of eight cart-poles of the belief, each from its own start, the same for every risk."""
    seed_everything(0)
    system = SYSTEMS["cartpole"]
    planner = changed(planner_of(system, 0), risk=RISKS[name])
    planner.thetas = 5
    planner.set_belief(Correlated())
    problem = problem_of(system, planner, 0.0)
    truths = Correlated().sample((8,))
    env = problem.worlds(8, ParameterRandomization(Listed(truths)), 7)
    return {"costs": (-returns(env, planner, problem.task.horizon)).tolist()}


def add_risk(table: ResultTable, found: dict[str, dict[str, Any]]) -> None:
    """Mean and worst costs."""
    for name in RISKS:
        if (run := found.get(f"risk {name}")) is not None:
            told = " ".join(f"{cost:.4g}" for cost in sorted(run["costs"]))
            table.add(
                f"correlated belief, {name}: mean cost of eight machines", statistics.fmean(run["costs"]), spread=told
            )
            table.add(f"correlated belief, {name}: cost of the worst", max(run["costs"]))


# --- speed ----------------------------------------------------------------------------------------------------------


def circle_planner(thetas: int, samples: int, dtype: torch.dtype) -> MPPI:
    """On the skid-steered robot, 50 steps ahead."""
    task = CircleTask()

    def state(observation: Tensor) -> TensorDict:
        return TensorDict({"qpos": observation}, batch_size=observation.shape[:1])

    return MPPI(
        SkidSteerKinematics(CIRCLE, dtype=dtype),
        lambda before, action, after: task.cost(after),
        BoxUniform(CIRCLE),
        state=state,
        bounds=Bounds.of(task.action_spec),
        noise=Knots(1.5),
        horizon=50,
        samples=samples,
        thetas=thetas,
        temperature=0.1,
    )


def speed() -> dict[str, Any]:
    """Seconds of processor time of a plan, for each planner in each of some turns."""
    kinds: dict[str, TensorDictModuleBase] = {
        "TorchRL, 1 x 256 x 50": torchrl_planner(50, 256),
        "TorchRL, 1 x 2048 x 50": torchrl_planner(50, 2048),
        "1 x 256 x 50": circle_planner(1, 256, torch.float32),
        "1 x 2048 x 50": circle_planner(1, 2048, torch.float32),
        "8 x 256 x 50": circle_planner(8, 256, torch.float32),
        "8 x 256 x 50, float64": circle_planner(8, 256, torch.float64),
    }
    seen = TensorDict({"observation": torch.tensor([1.0, 0.0, 1.57])}, [])
    for planner in kinds.values():
        planner(seen.clone())
    seconds: dict[str, list[float]] = {name: [] for name in kinds}
    for _ in range(TURNS):
        for name, planner in kinds.items():
            begun = time.process_time()
            planner(seen.clone())
            seconds[name].append(time.process_time() - begun)
    return seconds


def add_speed(table: ResultTable, found: dict[str, dict[str, Any]]) -> None:
    """Plans a second, and rollouts a second beside TorchRL's."""
    if "speed" not in found:
        return
    seconds = found["speed"]
    for name, each in seconds.items():
        hz = [1 / value for value in each]
        least = LEAST_HZ if name == "8 x 256 x 50" else None
        table.add(
            f"skid-steer, {name}: plans a second",
            statistics.median(hz),
            spread=f"{min(hz):.3g} to {max(hz):.3g}",
            unit="Hz",
            goal=None if least is None else f">= {least:g}",
            holds=None if least is None else statistics.median(hz) >= least,
        )
    for name, their_samples in {"1 x 256 x 50": 256, "1 x 2048 x 50": 2048, "8 x 256 x 50": 256}.items():
        peer, thetas = seconds[f"TorchRL, 1 x {their_samples} x 50"], int(name.split(" x ")[0])
        ratios = [thetas * theirs / ours for theirs, ours in zip(peer, seconds[name], strict=True)]
        least = None if thetas > 1 else LEAST_RATIO
        middle = statistics.median(ratios)
        table.add(
            f"skid-steer, {name}: rollouts a second beside TorchRL's with {their_samples} candidates",
            middle,
            spread=f"{min(ratios):.3g} to {max(ratios):.3g}",
            unit="times",
            goal=None if least is None else f">= {least:g}",
            holds=None if least is None else middle >= least,
        )


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
