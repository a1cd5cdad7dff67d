"""``make fetch``: what DDPG with hindsight reaches on the Fetch arm, with demonstrations and without, and how fast.

| case          | friction | shown   | seeds | goal                                              |
|---------------|----------|---------|-------|---------------------------------------------------|
| reach         | -        | nothing | 3     | 1.0 within 5,000 steps                            |
| push          | 1        | a fifth | 3     | .95 within 400,000 steps                          |
| push, alone   | 1        | nothing | 1     | .9                                                |
| push, uniform | 1        | nothing | 1     | beside it: minibatches of all steps alike         |
| push, prior   | U[.1, 2] | a fifth | 1     | .9, and .8 in the quarter of the smoothest blocks |
| push, told    | U[.1, 2] | a fifth | 1     | the same, the policy sees the friction            |
| slide         | .1       | nothing | 3     | .6                                                |
| slide, prior  | U[.1, 1] | nothing | 1     | a curve                                           |

A policy that sees the friction is judged with the friction of its world, and with one that is off by a Gaussian error
of OFF times the prior's width: on a machine it is given a belief's mean.

Success: the share of 256 episodes of exact worlds whose goal is reached at the last step. Learning is in lean worlds.
The scripted pusher stands beside. Each job is kept, and saved while it runs, so that a second start goes on.

    python -m recipes.studies.fetch [--cases push] [--seeds 1]       -> docs/results/fetch.json
    make fetch-told: --cases "push, prior" "push, told"              -> docs/results/fetch-told.json
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor

from envs.fetch import FRICTION, ScriptedPusher
from onlinebayes.experiments import status
from onlinebayes.objectives import DDPG
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import (
    BadInput,
    Checkpoints,
    ResultTable,
    generator,
    random_state,
    seed_everything,
    set_random_state,
)
from onlinebayes.trainers import Point, collector_of
from onlinebayes.transforms import Distribution, ParameterRandomization
from recipes.fetch import LEARNING, STEPS, WORLDS, Fetch, demonstrate, fetch, objective, outcomes, success
from recipes.studies.jobs import Places, check_names, each_kept_or_done, finished, printed_by

SEEDS, EPISODES, LOOKS, QUARTERS = (1, 2, 3), 256, 16, 4


@dataclass(frozen=True)
class Case:
    """One task and how it is learnt.

    Args:
        task: of the arm.
        batches: of one episode in each world.
        goal: least share of successes.
        friction: bounds of the friction in the worlds; the task's own without.
        demonstrations: share of a minibatch.
        frames_per_update: fresh frames for which one gradient step is taken.
        worlds: in which it learns.
        seeds: how many of the study's seeds it is learnt with.
        elsewhere: share of a minibatch from steps that lead elsewhere.
        sees_theta: whether the policy sees the friction.
    """

    task: str
    batches: int
    goal: float | None
    friction: tuple[float, float] | None = None
    demonstrations: float = 0.0
    frames_per_update: int = 16
    worlds: int = WORLDS
    seeds: int = 1
    elsewhere: float = 0.5
    sees_theta: bool = False


CASES: dict[str, Case] = {
    "reach": Case("reach", 2, 1.0, frames_per_update=4, worlds=50, seeds=3),
    "push": Case("push", 124, 0.95, demonstrations=0.2, frames_per_update=8, seeds=3),
    "push, alone": Case("push", 310, 0.9),
    "push, uniform": Case("push", 124, None, elsewhere=0.0),
    "push, prior": Case("push", 250, 0.9, (0.1, 2.0), demonstrations=0.2, frames_per_update=8),
    "push, told": Case("push", 250, 0.9, (0.1, 2.0), demonstrations=0.2, frames_per_update=8, sees_theta=True),
    "slide": Case("slide", 500, 0.6, frames_per_update=8, seeds=3),
    "slide, prior": Case("slide", 500, None, (0.1, 1.0), frames_per_update=8),
}
TOLD = ("push, prior", "push, told")
OFF = (0.05, 0.1)
"""Errors of a friction that is told, in widths of the prior."""


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    cases: tuple[str, ...] = tuple(CASES)
    """which ones"""
    seeds: tuple[int, ...] = SEEDS
    """of networks and worlds"""
    out: str = "out/fetch"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    check_names(study.cases, CASES)
    wanted = [(case, seed) for case in study.cases for seed in study.seeds[: CASES[case].seeds]]
    places = {job: Path(study.out) / file_of(job) for job in wanted}
    jobs = {(case, seed): partial(learnt, CASES[case], seed, place) for (case, seed), place in places.items()}
    found = each_kept_or_done("fetch", study.out, jobs, file_of, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def file_of(job: tuple[str, int]) -> str:
    """Name of a job's file, and of the folder where it is saved while it runs."""
    return f"{job[0].replace(', ', '-')}-{job[1]}"


def made_of(case: Case) -> tuple[Fetch, Distribution]:
    """The task, and the distribution of its worlds."""
    low, high = case.friction or (0.05, 2.0)
    space = ParameterSpace({} if case.task == "reach" else {FRICTION: Parameter(low, high)})
    made = fetch(case.task, space)
    return made, made.lean.prior if case.friction else Point(made.lean.simulator.nominal)


def learnt(case: Case, seed: int, place: Path) -> dict[str, Any]:
    """Learn, look at it on the way, and judge the last policy on exact worlds."""
    learner, course = policy_of(case, seed, place)
    made, worlds = made_of(case)
    found = success(made.exact, learner.policy, worlds, EPISODES)
    result = {**asdict(found), "course": course, "frames": case.batches * case.worlds * STEPS}
    if case.friction:
        result["quarters"] = quarters(made, learner, worlds)
    if case.sees_theta:
        result["off"] = [success(made.exact, misled(learner, made, off), worlds, EPISODES).last for off in OFF]
    if case.task == "push":
        result["scripted"] = success(made.exact, ScriptedPusher(), worlds, EPISODES).last
    return result


def policy_of(case: Case, seed: int, place: Path) -> tuple[DDPG, list[dict[str, float]]]:
    """The learner after its last batch, and how it came there; it goes on from what is saved in ``place``."""
    seed_everything(seed)
    made, worlds = made_of(case)
    learning = replace(LEARNING, frames_per_update=case.frames_per_update, demonstrations=case.demonstrations)
    learner = objective(made, learning, elsewhere=case.elsewhere, sees_theta=case.sees_theta)
    saved, course, done = Checkpoints(place, "fetch", keep=1), [], 0
    if (checkpoint := saved.load()) is not None:
        if checkpoint.state.get("case") != asdict(case):
            raise BadInput(f"{place} was begun with other settings", "take another --out, or delete that folder")
        learner.load_state_dict(checkpoint.state["objective"])
        course, done = checkpoint.state["course"], checkpoint.state["done"]
        set_random_state(checkpoint.state["random"])
    elif case.demonstrations:
        demonstrate(made, learner, worlds, 5, seed + 5000)
    if done == case.batches:
        return learner, course
    env = made.lean.worlds(case.worlds, ParameterRandomization(worlds), seed + 100 * done)
    collector, seconds = collector_of(env, learner.policy, STEPS), course[-1]["seconds"] if course else 0.0
    every = max(1, case.batches // LOOKS)
    for batch in range(done + 1, case.batches + 1):
        begun = time.process_time()
        data = collector.next()
        assert data is not None
        learner.update(data)
        seconds += time.process_time() - begun
        if batch % every == 0 or batch == case.batches:
            seen = success(made.lean, learner.policy, worlds, EPISODES // 2)
            course.append({"frames": batch * data.numel(), "seconds": seconds, **asdict(seen)})
            state = {"objective": learner.state_dict(), "course": course, "done": batch, "case": asdict(case)}
            saved.save({**state, "random": random_state()})
    return learner, course


def quarters(made: Fetch, learner: DDPG, worlds: Distribution) -> list[float]:
    """Success at the last step in quarters of the episodes, from the smoothest blocks to the roughest."""
    found = outcomes(made.exact, learner.policy, worlds, 4 * EPISODES, 78)
    order = found.theta[:, 0].argsort()
    return [float(part.double().mean()) for part in found.reached[order, -1].chunk(QUARTERS)]


def misled(learner: DDPG, made: Fetch, off: float) -> TensorDictSequential:
    """The policy in worlds whose friction it is told wrongly, by the same error in all of an episode.

    Args:
        learner: holds the policy.
        made: the task.
        off: standard deviation of the error, in widths of the prior.
    """
    box = made.exact.simulator.parameters[FRICTION]
    error = off * (box.high - box.low) * torch.randn(EPISODES, 1, generator=generator(79, "misled"))

    def told(theta: Tensor) -> Tensor:
        return (theta + error.to(theta)).clamp(box.low, box.high)

    return TensorDictSequential(TensorDictModule(told, ["theta"], ["theta"]), learner.policy)


def tabled(found: dict[tuple[str, int], dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all jobs."""
    pair = study.cases == TOLD
    command = "make fetch-told" if pair else printed_by("fetch", study)
    table = ResultTable("fetch-told" if pair else "fetch", command, study.seeds[:1] if pair else study.seeds)
    for name in study.cases:
        case, of = CASES[name], [job for (case, _), job in found.items() if case == name]
        last = [job["last"] for job in of]
        table.add_seeds(f"{name}: success on exact worlds", last)
        if case.goal is not None:
            table.add(f"{name}: the worst seed", min(last), goal=f">= {case.goal}", holds=min(last) >= case.goal)
        for key, told in (("ever", "at any step"), ("at_start", "before anything was done"), ("moved", "object moved")):
            table.add_seeds(f"{name}: {told}", [job[key] for job in of])
        if case.friction:
            for k, told in ((0, "smoothest"), (QUARTERS - 1, "roughest")):
                least = 0.8 if k == 0 and case.demonstrations else None
                table.add_seeds(f"{name}: {told} quarter", [job["quarters"][k] for job in of], least=least)
        for k, off in enumerate(OFF if case.sees_theta else ()):
            table.add_seeds(f"{name}: told {100 * off:g} % of the width wrong", [job["off"][k] for job in of])
        if "scripted" in of[0]:
            table.add_seeds(f"{name}: the scripted pusher", [job["scripted"] for job in of])
        table.add(f"{name}: steps", of[0]["frames"], unit="steps")
        table.add_seeds(f"{name}: processor time", [job["course"][-1]["seconds"] for job in of], unit="s")
        for step in course_of(of):
            table.add(f"{name}: after {step['frames']:,.0f} steps", step["last"], unit="median share, lean worlds")
    return table


def course_of(jobs: list[dict[str, Any]]) -> Iterator[dict[str, float]]:
    """The medians of the jobs' courses at each look."""
    for steps in zip(*(job["course"] for job in jobs), strict=True):
        middle = torch.tensor([[step["frames"], step["last"]] for step in steps]).median(0).values.tolist()
        yield dict(zip(("frames", "last"), middle, strict=True))


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
