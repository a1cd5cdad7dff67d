"""``make fetch-friction``: what trajectories of trained policies tell of the friction, by 2000 simulations.

| part     | trajectories                                       | goal [nats]                                   |
|----------|----------------------------------------------------|-----------------------------------------------|
| one      | one, from a random start                           | push U[.1, 2] >= 0, slide U[.1, 1] >= 1       |
| protocol | ten, from the same ten starts to the same ten goals | push U[.1, 1] >= 2.42, slide U[.1, 2] >= 3.24 |
| others   | the same, the rows of the thesis's other table     | push U[.1, 2] >= 2.18, slide U[.1, 1] >= 2.39 |

    figure = mean log q(theta | x) over 500 held-out thetas;   coverage error = mean over levels of | held - level |

The second part is the thesis's: its ten trajectories are one long observation, so that what differs is the friction
alone. The policies are those of ``make fetch``, their actions disturbed by a tenth. Each finished job is kept.

    python -m recipes.studies.fetch_friction [--questions "push, one"]       -> docs/results/fetch-friction.json
"""

from __future__ import annotations

import statistics
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor
from torchrl.envs.utils import ExplorationType, set_exploration_type

from envs.fetch import FRICTION, motion
from onlinebayes.embeddings import TransitionFeatures
from onlinebayes.experiments import status
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.objectives import Exploration
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import ResultTable, generator, seed_everything
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers.trajectories import Policy
from recipes.fetch import STEPS, Fetch, fetch, friction_estimator
from recipes.studies import fetch as learning
from recipes.studies.exact import coverage_error
from recipes.studies.jobs import Places, check_names, each_kept_or_done, finished, printed_by

SIMULATIONS, HELD_OUT, STARTS, EPOCHS, NOISE = 2000, 500, 10, 60, 0.1


@dataclass(frozen=True)
class Question:
    """One cell.

    Args:
        task: of the arm.
        starts: trajectories of one theta, from the same starts always; 1 for one from a start of its own.
        friction: bounds of the prior.
        goal: least mean log density of the truth [nats].
    """

    task: str
    starts: int
    friction: tuple[float, float]
    goal: float


QUESTIONS: dict[str, Question] = {
    "push, one": Question("push", 1, (0.1, 2.0), 0.0),
    "slide, one": Question("slide", 1, (0.1, 1.0), 1.0),
    "push, protocol": Question("push", STARTS, (0.1, 1.0), 2.42),
    "slide, protocol": Question("slide", STARTS, (0.1, 2.0), 3.24),
    "push, protocol of Table 5.1": Question("push", STARTS, (0.1, 2.0), 2.18),
    "slide, protocol of Table 4.1": Question("slide", STARTS, (0.1, 1.0), 2.391),
}


@dataclass(frozen=True, kw_only=True)
class Study(Places):
    """Options of the study."""

    questions: tuple[str, ...] = tuple(QUESTIONS)
    """which cells"""
    seeds: tuple[int, ...] = (1,)
    """of policies, simulations and networks"""
    policies: Path = Path("out/fetch")
    """where ``make fetch`` keeps its jobs"""
    out: str = "out/fetch_friction"


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    check_names(study.questions, QUESTIONS)
    wanted = [(name, seed) for seed in study.seeds for name in study.questions]
    missing = [job for job in wanted if not (Path(study.out) / f"{learning.file_of(job)}.json").exists()]
    for task, seed in dict.fromkeys((QUESTIONS[name].task, seed) for name, seed in missing):
        trained(task, seed, study.policies)  # two jobs that ask for one policy would learn it twice
    jobs = {(name, seed): partial(answered, QUESTIONS[name], seed, study.policies) for name, seed in wanted}
    found = each_kept_or_done("fetch-friction", study.out, jobs, learning.file_of, study.ray_workers)
    return finished(tabled(found, study), study.results, found)


def answered(question: Question, seed: int, policies: Path) -> dict[str, Any]:
    """Simulate, fit, and judge the posteriors of held-out trajectories."""
    made = fetch(question.task, space_of(question))
    policy = disturbed(made, trained(question.task, seed, policies))
    seed_everything(seed)
    data = trajectories(made, policy, question, SIMULATIONS + HELD_OUT, seed)
    estimator = friction_estimator(EPOCHS, made.exact.prior, features_of(question.starts))
    estimator.fit(data[:SIMULATIONS], generator=generator(seed, "fit"))
    held = data[SIMULATIONS:]
    theta, posteriors = held["theta"][:, 0].double(), estimator.each(held.unsqueeze(1))
    density = posteriors.log_prob(theta)
    alpha = credibility_of(posteriors, theta, samples=500, generator=generator(seed, "credibility"))
    return {
        "density": float(density.mean()),
        "error": float(density.std() / len(density) ** 0.5),
        "coverage": coverage_error(alpha.tolist()),
        "prior": float(made.exact.prior.log_prob(theta).mean()),
    }


def space_of(question: Question) -> ParameterSpace:
    """The unknown friction."""
    return ParameterSpace({FRICTION: Parameter(*question.friction)})


def trained(task: str, seed: int, policies: Path) -> Policy:
    """The policy that learnt in worlds of the prior, without its exploration."""
    case = learning.CASES[f"{task}, prior"]
    learner, _ = learning.policy_of(case, seed, policies / learning.file_of((f"{task}, prior", seed)))
    return learner.policy.select_subsequence(out_keys=["action"])[0]


def disturbed(made: Fetch, policy: Policy) -> Policy:
    """The policy, its actions off by a tenth of their range."""
    space = made.task.action_spec.space
    shaken = Exploration(space.low, space.high, epsilon=0.0, noise=NOISE)
    return TensorDictSequential(policy, TensorDictModule(shaken, ["action"], ["action"]))


@torch.no_grad()
def trajectories(made: Fetch, policy: Policy, question: Question, number: int, seed: int) -> TensorDict:
    """``number`` trajectories (N, T), the values of ten beside each other where there are ten starts."""
    theta = made.exact.prior.sample((number,), generator(seed, "theta"))
    env = SimulatorEnv(made.exact.simulator.with_worlds(number), made.task, seed=seed)
    task, draws = made.task, generator(seed, "starts")
    parts = []
    for _ in range(question.starts):
        start = task.start(theta[: 1 if question.starts > 1 else number], draws).expand(number)
        parts.append(rollout(env, policy, theta, start))
    wide = {key: torch.cat([part[key] for part in parts], dim=-1) for key in ("observation", "action")}
    following = torch.cat([part["next", "observation"] for part in parts], dim=-1)
    values = {**wide, "theta": parts[0]["theta"], "next": {"observation": following}}
    return TensorDict(values, batch_size=(number, STEPS))


def rollout(env: SimulatorEnv, policy: Policy, theta: Float[Tensor, "N P"], start: TensorDict) -> TensorDict:
    """One episode in each world, from told states."""
    env.reset()
    told = env.get_state()
    for key in ("qpos", "qvel", ("task", "goal")):
        told["state", key] = start[key].clone()
    told["state", "theta"] = theta.clone()
    told["state", "qacc_warmstart"].zero_()
    begun = env.reset(told, set_state=True)
    with set_exploration_type(ExplorationType.RANDOM):
        return env.rollout(STEPS, policy, auto_reset=False, tensordict=begun, break_when_any_done=False)


def features_of(starts: int) -> TransitionFeatures:
    """Build features of the motion in all starts; with products for one start only, of ten there are too many."""
    return TransitionFeatures(12 * starts, 4 * starts, view=side_by_side(motion, starts), products=starts == 1)


def side_by_side(view: Callable[[Tensor], Tensor], number: int) -> Callable[[Tensor], Tensor]:
    """The view of each of ``number`` observations that lie beside each other."""
    return lambda wide: view(wide.unflatten(-1, (number, -1))).flatten(-2)


def tabled(found: dict[tuple[str, int], dict[str, Any]], study: Study) -> ResultTable:
    """Rows of all cells."""
    table = ResultTable("fetch-friction", printed_by("fetch-friction", study), study.seeds)
    for name in study.questions:
        question, of = QUESTIONS[name], [found[name, seed] for seed in study.seeds]
        told = f"{name}, U{list(question.friction)}"
        table.add_seeds(f"{told}: log density", [o["density"] for o in of], unit="nats", least=question.goal)
        table.add(f"{told}: its standard error", statistics.median(o["error"] for o in of), unit="nats")
        table.add_seeds(f"{told}: coverage error", [o["coverage"] for o in of], most=0.05)
        table.add(f"{told}: the prior", of[0]["prior"], unit="nats")
    return table


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
