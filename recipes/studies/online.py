"""Online BayesSim: one run, told step by step, and the study over truths, sensor noise and baselines.

Truths: point s of the unscrambled Sobol sequence in two dimensions (``scipy.stats.qmc.Sobol(d=2, scramble=False)``)
over the prior's box for seed s = 1 ... 5; point 0 is the box's corner and is skipped. Seed 0 stands for Gymnasium's
default parameters.
"""

from __future__ import annotations

import json
import logging
import statistics
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import torch
from jaxtyping import Float
from scipy.stats import qmc
from torch import Tensor

from onlinebayes.inference import BoxUniform, plots
from onlinebayes.objectives import Objective
from onlinebayes.runs import BadInput, Progress, ResultTable, write_atomic
from onlinebayes.trainers import OnlineState
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.online_problem import Point, Problem, offline, online, score

NOISES = (0.0, 0.01)
SEEDS = (0, 1, 2, 3, 4, 5)


@dataclass
class Settings:
    """One run, or with ``--study`` all of them."""

    seed: int = 0
    """which truth and which random numbers: 0 for Gymnasium's default parameters, s for point s of the sequence"""
    noise: float = 0.0
    """standard deviation of the sensor noise, as a share of each observed value's range"""
    study: bool = False
    """run all seeds, noises and baselines, and write docs/results"""
    processes: int = 2
    """of the study"""
    out: str = "out"
    """folder for the plot and for the study's finished runs, which a second start does not repeat"""
    results: str = "docs/results"
    """folder of the study's tables"""


@dataclass(frozen=True)
class Outcome:
    """How one run ended.

    Attributes:
        kind: ``"online"``, ``"oracle"`` or ``"prior"``.
        seed: of the truth and the run.
        noise: share of each range.
        log_density: of the truth after each outer step; empty for the baselines.
        score: mean return on the real system.
        noisy_score: the same behind noisy sensors, for the baselines, which are trained once for both.
        frames: that the policy learnt from.
    """

    kind: str
    seed: int
    noise: float
    log_density: tuple[float, ...]
    score: float
    noisy_score: float
    frames: int


def main(problem: Problem, settings: Settings) -> int:
    """What a recipe does; returns the exit status."""
    settle_process()
    if settings.seed < 0 or not 0 <= settings.noise < 1:
        raise BadInput(f"seed {settings.seed}, noise {settings.noise}", "needs seed >= 0 and 0 <= noise < 1")
    if settings.study:
        return study(problem, settings)
    return single(problem, settings)


def settle_process() -> None:
    """One thread a process, and TorchRL's notes on its storages stay out of the progress."""
    torch.set_num_threads(1)
    logging.getLogger("torchrl").setLevel(logging.WARNING)


def truth_of(problem: Problem, seed: int) -> Float[Tensor, " P"]:
    """The hidden theta of a seed, see the module."""
    if seed == 0:
        return problem.simulator.nominal
    sobol = qmc.Sobol(d=len(problem.space), scramble=False).fast_forward(seed)
    return problem.space.from_unit(torch.from_numpy(sobol.random(1)[0]))


def single(problem: Problem, settings: Settings) -> int:
    """One online run with a table on the screen and a corner plot in the out folder."""
    truth = truth_of(problem, settings.seed)
    prior = float(BoxUniform(problem.space).log_prob(truth))
    print(f"hidden truth: {_named(problem, truth)}; the prior's log density of it: {prior:.2f}")
    print(f"{'step':>5}{'frames':>9}{'log density':>13}{'return':>9}   posterior mean", flush=True)

    def on_step(state: OnlineState, objective: Objective) -> None:
        assert state.posterior is not None
        density = float(state.posterior.log_prob(truth))
        reached = score(problem, objective.policy, truth, settings.noise)
        mean = _named(problem, state.posterior.mean())
        print(f"{state.step:>5}{state.frames:>9}{density:>13.2f}{reached:>9.1f}   {mean}", flush=True)

    state, _ = online(problem, truth, settings.noise, settings.seed, on_step)
    if state.posterior is None:
        print(f"stopped before the first outer step was complete; kept: {state.kept()}")
        return 130
    picture = Path(settings.out) / problem.name / "corner.png"
    figure = plots.corner(state.posterior, truth=truth, prior=BoxUniform(problem.space), title=problem.name)
    plots.save(figure, picture)
    print(f"posterior with truth and prior: {picture}")
    if state.interrupted:
        print(f"stopped; kept: {state.kept()}")
        return 130
    return 0 if float(state.posterior.log_prob(truth)) > prior else 1


def study(problem: Problem, settings: Settings) -> int:
    """All runs in processes of their own; finished ones are kept, so that an interrupted study goes on."""
    folder = Path(settings.out) / f"{problem.name}-study"
    jobs = [(kind, seed, 0.0) for seed in SEEDS for kind in ("online", "oracle", "prior")]
    jobs += [("online", seed, noise) for noise in NOISES[1:] for seed in SEEDS]
    files = {job: folder / f"{job[0]}-{job[1]}-{job[2]:g}.json" for job in jobs}
    todo = [job for job in jobs if not files[job].exists()]
    try:
        with Progress(problem.name, len(jobs)) as progress:
            progress.update(len(jobs) - len(todo), f"finished runs lie in {folder}")
            for outcome in _in_processes(problem, todo, settings.processes):
                job = (outcome.kind, outcome.seed, outcome.noise)
                write_atomic(files[job], json.dumps(asdict(outcome)) + "\n")
                done = sum(path.exists() for path in files.values())
                progress.update(done, f"{job[0]} seed {job[1]} noise {job[2]:g}: return {outcome.score:.1f}")
    except KeyboardInterrupt:
        done = sum(path.exists() for path in files.values())
        print(f"stopped; {done} of {len(jobs)} runs are kept in {folder}; the same command goes on from there")
        return 130
    table = tabulate(problem, [Outcome(**json.loads(path.read_text())) for path in files.values()])
    print(table.to_markdown())
    print(f"written: {table.write(settings.results)}")
    return 0 if table.holds else 1


def run(problem: Problem, kind: str, seed: int, noise: float) -> Outcome:
    """One run of the study."""
    settle_process()
    truth, densities = truth_of(problem, seed), []

    def on_step(state: OnlineState, _: Objective) -> None:
        assert state.posterior is not None
        densities.append(float(state.posterior.log_prob(truth)))

    if kind == "online":
        state, objective = online(problem, truth, noise, seed, on_step)
        if state.interrupted:
            raise KeyboardInterrupt
        frames = state.frames
    else:
        drawn = ParameterRandomization(Point(truth) if kind == "oracle" else BoxUniform(problem.space))
        objective = offline(problem, drawn, noise, seed)
        schedule = problem.schedule
        frames = schedule.steps * schedule.policy_batches * problem.worlds * problem.batch_steps
    reached, noisy = (score(problem, objective.policy, truth, level) for level in (noise, max(NOISES)))
    return Outcome(kind, seed, noise, tuple(densities), reached, noisy, frames)


def tabulate(problem: Problem, outcomes: Iterable[Outcome]) -> ResultTable:
    """Every seed, the medians and whether the goals hold."""
    by_job = {(o.kind, o.seed, o.noise): o for o in outcomes}
    table = ResultTable(problem.name, f"make {problem.name}", SEEDS)
    for noise in NOISES:
        label = f"sensor noise {100 * noise:g} %" if noise else "no noise"
        for seed in SEEDS:
            _rows(problem, table, by_job, seed, noise, label)
        _medians(problem, table, by_job, noise, label)
    return table


Jobs = dict[tuple[str, int, float], Outcome]


def _rows(problem: Problem, table: ResultTable, jobs: Jobs, seed: int, noise: float, label: str) -> None:
    truth = truth_of(problem, seed)
    head = f"{label}, seed {seed} ({_named(problem, truth)})"
    if seed == 0:
        head += " [Gymnasium's default]"
    online_run = jobs["online", seed, noise]
    path = " ".join(f"{value:.1f}" for value in online_run.log_density)
    prior = float(BoxUniform(problem.space).log_prob(truth))
    table.add(f"{head}: log density of the truth", online_run.log_density[-1], spread=f"by step: {path}", unit="nats")
    table.add(f"{head}: the prior's log density", prior, unit="nats")
    goal = problem.goals.default_score if seed == 0 and not noise else None
    holds = None if goal is None else online_run.score >= goal
    table.add(f"{head}: return", online_run.score, goal=None if goal is None else f">= {goal:g}", holds=holds)
    for kind in ("oracle", "prior"):
        baseline = jobs[kind, seed, 0.0]
        name = "the oracle's return" if kind == "oracle" else "return of a policy trained on the prior"
        table.add(f"{head}: {name}", baseline.noisy_score if noise else baseline.score)


def _medians(problem: Problem, table: ResultTable, jobs: Jobs, noise: float, label: str) -> None:
    goals, seeds = problem.goals, SEEDS[1:]

    def add(name: str, value: Callable[[int], float], unit: str, bound: float | None, above: bool) -> None:
        values = [value(seed) for seed in seeds]
        median = statistics.median(values)
        # The goals were set for noise-free sensors; a noise-free density has no bound, so the noisy rows stand beside.
        bound = None if noise else bound
        holds = None if bound is None else (median >= bound if above else median <= bound)
        goal = None if bound is None else f"{'>=' if above else '<='} {bound:g}"
        spread = f"{min(values):.4g} to {max(values):.4g}"
        table.add(f"{label}, median of seeds 1-5: {name}", median, spread=spread, unit=unit, goal=goal, holds=holds)

    def regret(seed: int) -> float:
        oracle = jobs["oracle", seed, 0.0]
        return (oracle.noisy_score if noise else oracle.score) - jobs["online", seed, noise].score

    add("log density", lambda s: jobs["online", s, noise].log_density[-1], "nats", goals.log_density, True)
    add("return", lambda s: jobs["online", s, noise].score, "", goals.score, True)
    add("oracle's return minus return", regret, "", goals.regret, False)


def _in_processes(problem: Problem, jobs: list[tuple[str, int, float]], processes: int) -> Iterator[Outcome]:
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    try:
        futures = [pool.submit(run, problem, *job) for job in jobs]
        for future in as_completed(futures):
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def _named(problem: Problem, theta: Tensor) -> str:
    return ", ".join(f"{name} {value:.4g}" for name, value in zip(problem.space, theta.tolist(), strict=True))
