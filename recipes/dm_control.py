"""A task of dm_control's suite whose physics differ from world to world: SAC swings up poles that nobody has weighed.

    python -m recipes.dm_control [--task cartpole-swingup] [--short]      some minutes; Ctrl-C and again goes on

Mass of the pole and strength of the motor are drawn anew at every reset. The policy that learns in such worlds is
judged in the model as it ships. Needs the extra dm-control.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import torch

from envs.dm_control import suite
from onlinebayes import experiments
from onlinebayes.experiments import Run, status
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import SACSettings, sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Shape
from onlinebayes.simulators.mujoco import drawing
from onlinebayes.trainers import EnvPlayer, EnvProblem, Sizes, online_trainer

SPACES = {
    "cartpole-swingup": ParameterSpace(
        {"body.pole_1.mass": Parameter(0.05, 0.2, "kg", "log"), "actuator.slide.gear": Parameter(5.0, 20.0, "N")}
    ),
    "walker-walk": ParameterSpace({"body.torso.mass": Parameter(5.0, 20.0, "kg", "log")}),
}


@dataclass(frozen=True)
class Settings(experiments.Settings):
    """One run."""

    task: str = "cartpole-swingup"
    """domain and task of the suite"""
    noise: float = 0.0
    """standard deviation of the sensor noise"""
    kind: Literal["prior", "oracle"] = "prior"
    """a policy in worlds of the prior, or an oracle's in the model as it ships"""


def look(env: Any) -> tuple[tuple[Shape, ...], torch.Tensor]:
    """The model as it stands."""
    model = env.physics.model.ptr
    return drawing.shapes(model), drawing.poses(model, env.physics.data.qpos[None])[0]


def build(settings: Settings) -> Run[EnvProblem]:
    """The whole composition: environment, prior, objective, trainer."""
    if settings.task not in SPACES:
        raise BadInput(f"task '{settings.task}' has no parameters here", f"add some to SPACES; known: {list(SPACES)}")
    space = SPACES[settings.task]
    make = partial(suite, settings.task, space)
    shipped, dt = make().reset()["theta"], make().inner.control_timestep()
    horizon = 200 if settings.short else 1000
    problem = EnvProblem(
        make, BoxUniform(space), horizon, settings.noise * torch.ones(1), episodes=2, name=settings.task
    )
    learning = SACSettings(normalise=True, memory=100_000, frames_per_update=4, tau=0.01, alpha=0.1)
    objective = sac(*problem.specs, settings.learning(learning))
    steps, batches = (2, 4) if settings.short else (8, 50)
    workers = settings.workers()
    trainer = online_trainer(
        problem,
        objective,
        schedule=settings.schedule(steps, batches, real_steps=50),
        sizes=Sizes(worlds=8, batch_steps=32),
        worlds=settings.worlds(problem, shipped),
        workers=workers,
        seed=settings.seed,
    )
    player = EnvPlayer(problem, objective.policy, shipped, look, dt)
    before = None if settings.short else problem.score(objective.policy, shipped)
    return Run(problem, trainer, shipped, player, to_beat=before, workers=workers)


def run(settings: Settings) -> int:
    """One run in a folder of its own; 0 when the policy is better than it was."""
    return experiments.run(f"dm_control-{settings.task}", build, settings)


if __name__ == "__main__":
    sys.exit(status(run, Settings, __doc__))
