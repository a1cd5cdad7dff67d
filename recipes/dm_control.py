"""A task of dm_control's suite whose physics differ from world to world: SAC swings up poles that nobody has weighed.

    python -m recipes.dm_control [--task cartpole-swingup] [--short]      some minutes; needs the extra dm-control

Mass of the pole and strength of the motor are drawn anew at every reset. The policy that learns in such worlds is
judged in the model as it ships.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torchrl.envs import SerialEnv, TransformedEnv
from torchrl.envs.utils import ExplorationType, set_exploration_type

from envs.dm_control import suite
from onlinebayes.inference import BoxUniform
from onlinebayes.loggers import RunRecorder
from onlinebayes.objectives import sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, Checkpoints, Progress, seed_everything
from onlinebayes.simulators import Shape
from onlinebayes.simulators.mujoco import drawing
from onlinebayes.trainers import Point, Policy, collector_of, returns
from onlinebayes.transforms import Distribution, ParameterRandomization
from recipes.common import settle, status

SPACES = {
    "cartpole-swingup": ParameterSpace(
        {"body.pole_1.mass": Parameter(0.05, 0.2, "kg", "log"), "actuator.slide.gear": Parameter(5.0, 20.0, "N")}
    ),
    "walker-walk": ParameterSpace({"body.torso.mass": Parameter(5.0, 20.0, "kg", "log")}),
}
WORLDS, STEPS, EPISODE = 8, 32, 1000


@dataclass(frozen=True)
class Settings:
    """One run."""

    task: str = "cartpole-swingup"
    """domain and task of the suite"""
    seed: int = 0
    """of networks, worlds and draws"""
    batches: int = 400
    """of 8 worlds x 32 steps"""
    short: bool = False
    """a small budget: shows that the pieces connect"""
    out: str = "out/dm_control"
    """the policy goes here"""


def worlds(task: str, number: int, distribution: Distribution, seed: int) -> TransformedEnv:
    """Several worlds, one after the other, with parameters from a distribution."""
    env = TransformedEnv(SerialEnv(number, lambda: suite(task, SPACES[task])), ParameterRandomization(distribution))
    env.set_seed(seed)
    return env


def filmed(task: str, policy: Policy, steps: int) -> tuple[tuple[Shape, ...], torch.Tensor, float]:
    """Shapes, poses and time step of one episode in the model as it ships."""
    env, qpos = suite(task, SPACES[task]), []
    physics = env.inner.physics
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        env.rollout(steps, policy, callback=lambda _env, _data: qpos.append(physics.data.qpos.copy()))
    model = physics.model.ptr
    return drawing.shapes(model), drawing.poses(model, np.stack(qpos)), env.inner.control_timestep()


def main(settings: Settings) -> int:
    """Train, judge in the model as it ships, save; 0 when the policy is better than it was."""
    settle()
    seed_everything(settings.seed)
    if settings.task not in SPACES:
        raise BadInput(f"task '{settings.task}' has no parameters here", f"add some to SPACES; known: {list(SPACES)}")
    space = SPACES[settings.task]
    env = worlds(settings.task, WORLDS, BoxUniform(space), settings.seed)
    specs = env.observation_spec["observation"][0], env.action_spec[0]
    objective = sac(*specs, normalise=True, memory=100_000, frames_per_update=4, tau=0.01, alpha=0.1)
    shipped = suite(settings.task, space).reset()["theta"]
    judged = worlds(settings.task, 2, Point(shipped), 99)
    episode = 200 if settings.short else EPISODE
    before = float(returns(judged, objective.policy, episode).mean())
    batches = 4 if settings.short else settings.batches
    collector = collector_of(env, objective.policy, STEPS)
    recorder = RunRecorder(settings.out, "dm_control", space, seconds=10.0, truth=shipped)
    with Progress("dm_control", batches) as progress:
        for batch in range(1, batches + 1):
            data = collector.next()
            assert data is not None
            losses = objective.update(data)
            recorder.step(batch, {f"losses/{name}": value for name, value in losses.items()})
            progress.update(batch, f"reward a step {float(data['next', 'reward'].mean()):.3f}")
    after = float(returns(judged, objective.policy, episode).mean())
    recorder.episode(batches, "real", *filmed(settings.task, objective.policy, episode))
    recorder.close()
    saved = Checkpoints(Path(settings.out), f"dm_control-{settings.task}").save(
        {"policy": objective.policy.state_dict()}
    )
    told = ", ".join(f"{name} {value:.3g}" for name, value in zip(space.names, shipped.tolist(), strict=True))
    print(f"return in the model as it ships ({told}): {before:.1f} before, {after:.1f} after")
    print(f"written: {saved} and {recorder.path}   open it with: rerun {recorder.path}")
    return 0 if settings.short or after > before else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
