"""A log that cannot tell two laws apart, and a policy for both: does the motor answer late, or slowly?

    python -m recipes.tie [--seed S] [--short]      three minutes

The pendulum was moved slowly and seen by a camera. From such a log a dead time and a slow drive look alike, and
``refine`` says so: its result is a set of models with weights. A policy trained for one of them fails where the other
is true, unless one is lucky; a policy trained in the worlds of both holds the pendulum either way.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import torch

from envs.driven_pendulum import BalanceTask, DrivenPendulumRig, Encoder, MeasuredSet
from envs.driven_pendulum.sets import drive
from onlinebayes.criticism import ModelMixture, worlds_of
from onlinebayes.experiments import Options, closing_line, place_of, status
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import PPO
from onlinebayes.problems import criticise, load_problem
from onlinebayes.report import write_report
from onlinebayes.runs import generator, seed_everything
from onlinebayes.trainers import Journal, PolicyFiles, Problem, collector_of, improve
from onlinebayes.transforms import Distribution, ParameterRandomization
from recipes.demo.measure import hidden_truth, write_problem
from recipes.demo.policy import Training, balance_ppo, player, training_worlds

TRIED = ("dry_friction", "quadratic_drag", "joint_stiffness", "actuator_delay", "actuator_lag")
CAMERA = Encoder(sd=0.05)
RUNS, SECONDS, PERIOD = 9, 4.0, 0.02


def main(settings: Options) -> int:
    """The whole example; returns the exit status."""
    seed_everything(settings.seed)
    place, small, seed = place_of("tie", settings), settings.short, settings.seed
    training = Training(worlds=64, batches=8) if small else Training()

    # A log, and what it leaves open.
    log = write_problem(slow_log(seed), place)
    found = criticise("refine", replace(load_problem(log), candidates=TRIED))
    write_report(found, place / "refine", title="a pendulum seen by a camera", problem=log)
    models = worlds_of(found)
    for name, weight in zip(models.names, models.weight.tolist(), strict=True):
        print(f"{name}: believed to {100 * weight:.0f} %")

    # One simulator has the laws of all models. A policy for each of them alone, and one for all.
    task = BalanceTask()
    problem = Problem(training_worlds(models.simulator, training, task.period), task, BoxUniform(models.space))
    policies = {}
    for k, name in enumerate(models.names):
        policies[name] = balance_ppo(problem, training, seed)
        list(trained(policies[name], problem, models.alone(k), training, seed))
    policies["all of them"] = both = balance_ppo(problem, training, seed)
    shown, open_models = player(problem, both.policy, hidden_truth(seed)), f"worlds of {' and '.join(models.names)}"
    files = PolicyFiles(place, "tie", both, problem, open_models)
    with Journal(place, "tie", BoxUniform(models.space), shown, watchers=(files,)) as journal:
        for frames, losses in trained(both, problem, models, training, seed):
            journal.step("policy", frames=frames, losses=losses, figures={"return": worst(problem, both, models)})

    for name, objective in policies.items():
        returns = ", ".join(f"{value:.0f} with {law}" for law, value in scores(problem, objective, models).items())
        print(f"return of 100, policy for {name}: {returns}")
    print(closing_line(place))
    unlucky = min(worst(problem, policies[name], models) for name in models.names)
    return 0 if len(models.names) > 1 and (small or worst(problem, both, models) > unlucky) else 1


def slow_log(seed: int) -> MeasuredSet:
    """The rig of this seed moved by two slow tones a run, below 0.6 Hz."""
    draw, times = generator(seed, "slow log"), PERIOD * torch.arange(round(SECONDS / PERIOD) + 1, dtype=torch.float64)
    frequency = 0.2 + 0.4 * torch.rand(RUNS, 2, 1, generator=draw, dtype=torch.float64)
    command = 1.2 * torch.sin(2 * math.pi * frequency * times).mean(1)
    rig, truth = DrivenPendulumRig(dt=PERIOD), hidden_truth(seed)
    angle = drive(rig, rig.parameters.vector(truth).expand(RUNS, -1), times, command)
    names = tuple(f"run{k + 1}" for k in range(RUNS))
    return MeasuredSet(names, names[-2:], times, command, CAMERA.read(angle, draw), CAMERA, truth, None)


def trained(
    objective: PPO, problem: Problem, worlds: Distribution, how: Training, seed: int
) -> Iterator[tuple[int, dict[str, float]]]:
    """Train a policy in worlds; gives the frames and the last losses of each quarter."""
    env = problem.worlds(how.worlds, ParameterRandomization(worlds), seed)
    collector, ends = collector_of(env, objective.policy, how.steps), [k * how.batches // 4 for k in range(5)]
    told: list[tuple[int, dict[str, float]]] = []

    def after(_: int, frames: int, losses: dict[str, float]) -> bool:
        told.append((frames, losses))
        return True

    for begin, end in pairwise(ends):
        improve(objective, collector, end, after, begin=begin)
        yield sum(frames for frames, _ in told[begin:end]), told[-1][1]


def scores(problem: Problem, objective: PPO, models: ModelMixture) -> dict[str, float]:
    """Mean return of a policy on the machine that each of the models describes."""
    return {name: problem.score(objective.policy, mean) for name, mean in zip(models.names, models.mean, strict=True)}


def worst(problem: Problem, objective: PPO, models: ModelMixture) -> float:
    """Return on the machine on which a policy does worst."""
    return min(scores(problem, objective, models).values())


if __name__ == "__main__":
    sys.exit(status(main, Options, __doc__))
