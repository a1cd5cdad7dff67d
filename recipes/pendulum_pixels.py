"""Pendulum seen by a camera under changing light: its length and mass are inferred from frames, on which SAC acts.

    python -m recipes.pendulum_pixels [--seed S] [--kind oracle]     some ten minutes; Ctrl-C and again goes on

A small convolution reads three frames that follow each other and tells what the sensors of ``recipes.pendulum`` would:
cos, sin and rate. It learns that in simulation, where they are known, and is kept beside the runs. Then it stands in
the environment as one more transform: policy, estimator and trainer are those of ``recipes.pendulum``, and the real
system's frames go the same way. The camera is ``envs.pendulum_camera``; everything else between it and the policy is
TorchRL's. With seed 0 the belief ends as good as one from states; the policy takes ten steps to a return of -311, where
states give -171 in six.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path

import torch
from jaxtyping import Float, UInt8
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.envs import Transform
from torchrl.envs.transforms import ModuleTransform
from torchrl.modules import ConvNet

from envs.pendulum import MAX_SPEED, Pendulum, PendulumTask
from envs.pendulum_camera import SIZE, PendulumCamera
from onlinebayes.experiments import Run, Settings, hidden_truth, main
from onlinebayes.inference import BoxUniform, filtered_estimator, fit
from onlinebayes.objectives import sac
from onlinebayes.runs import BadInput, Progress, read_arrays, seed_everything, write_arrays
from onlinebayes.trainers import Problem, Sizes, online_trainer
from onlinebayes.transforms import ParameterRandomization
from recipes.pendulum import LEARNING, SPACE, state

FRAMES, WORLDS, STEPS, MINIBATCH, PASSES = 3, 64, 50, 256, 12
ROLLOUTS, SHORT = 150, 3
"""Rollouts of 64 worlds that the reader learns from, each in light of its own; it sees a frame once."""

CONTENT = "reader of pendulum frames"


class FrameReader(nn.Module):
    """A small convolution: three frames -> cos, sin, rate [1, 1, rad/s]."""

    def __init__(self) -> None:
        super().__init__()
        self.convolution = ConvNet(FRAMES, num_cells=[16, 32, 32], kernel_sizes=4, strides=2)
        size = self.convolution(torch.zeros(1, FRAMES, SIZE, SIZE)).shape[-1]
        self.head = nn.Sequential(nn.Linear(size, 64), nn.ELU(), nn.Linear(64, 3))
        self.register_buffer("scale", torch.tensor((1.0, 1.0, MAX_SPEED)))

    def forward(self, frames: UInt8[Tensor, "*B F y x"]) -> Float[Tensor, "*B 3"]:
        """Brightness and contrast are taken out of the frames first."""
        sd, mean = torch.std_mean(frames.float(), dim=(-3, -2, -1), keepdim=True)
        read: Tensor = self.head(self.convolution((frames - mean) / sd.clamp_min(1.0)))
        return read * self.get_buffer("scale")


def read_by(reader: FrameReader) -> Transform:
    """What the reader reads is the observation."""
    return ModuleTransform(module=TensorDictModule(reader, ["pixels"], ["observation"]), no_grad=True)


def filmed(problem: Problem, seed: int) -> Problem:
    """The problem with a camera beside its sensors."""
    return replace(problem, transforms=lambda: [PendulumCamera(FRAMES, seed=seed)])


def teach(reader: FrameReader, problem: Problem, rollouts: int, seed: int) -> None:
    """Least squares on frames of random actions in worlds of the prior."""
    env = problem.worlds(WORLDS, ParameterRandomization(problem.prior), seed)
    adam = torch.optim.Adam(reader.parameters())
    schedule = torch.optim.lr_scheduler.OneCycleLR(adam, 2e-3, PASSES * rollouts)
    with Progress("learning to read frames", rollouts) as progress:
        for k in range(rollouts):
            seen = env.rollout(STEPS, break_when_any_done=False).reshape(-1)["next"]
            for some in torch.randperm(len(seen)).split(MINIBATCH)[:PASSES]:
                wrong = (reader(seen["pixels"][some]) - seen["observation"][some]) / reader.get_buffer("scale")
                adam.zero_grad()
                wrong.square().mean().backward()
                adam.step()
                schedule.step()
            progress.update(k + 1, f"error {float(wrong.detach().square().mean().sqrt()):.3f} of the range")


def taught(problem: Problem, settings: Settings) -> FrameReader:
    """The reader that is kept beside the runs, or a fresh one that is taught and kept."""
    rollouts, reader = SHORT if settings.short else ROLLOUTS, FrameReader()
    path = Path(settings.out) / f"pendulum_pixels-reader-{settings.seed}-{rollouts}.safetensors"
    if path.exists():
        reader.load_state_dict({name: torch.from_numpy(array) for name, array in read_arrays(path, CONTENT)[0].items()})
    else:
        teach(reader, problem, rollouts, settings.seed + 3000)
        path.parent.mkdir(parents=True, exist_ok=True)
        arrays = {name: value.numpy() for name, value in reader.state_dict().items()}
        write_arrays(path, CONTENT, arrays, {"rollouts": rollouts, "seed": settings.seed})
    return reader.eval().requires_grad_(False)


@dataclass(frozen=True)
class FilmedSettings(Settings):
    """Settings of a run; the camera has noise of its own."""

    noise: float = 0.0


def build(settings: Settings) -> Run:
    """The whole composition: camera and reader, then that of ``recipes.pendulum``."""
    if settings.noise:
        raise BadInput(f"noise {settings.noise}", "the camera has noise of its own: leave out --noise")
    plain, seeds = Problem(Pendulum(SPACE), PendulumTask(), BoxUniform(SPACE)), count(settings.seed + 10_000)
    reader = taught(filmed(plain, settings.seed + 3000), settings)
    seed_everything(settings.seed)  # the same run, whether the reader was kept or not
    problem = replace(plain, transforms=lambda: [PendulumCamera(FRAMES, seed=next(seeds)), read_by(reader)])
    truth = hidden_truth(SPACE, settings.seed, {"length": 1.0, "mass": 1.0}, settings.truth)
    steps, batches, simulations, epochs = (2, 3, 100, 4) if settings.short else (10, 20, 300, 25)
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=1e-3)
    trainer = online_trainer(
        problem,
        sac(*problem.specs, settings.learning(LEARNING)),
        estimator=filtered_estimator(problem.simulator, problem.task, state=state, train=train),
        real=problem.hidden(truth, settings.seed + 2000),
        schedule=settings.schedule(steps, batches, real_steps=STEPS),
        sizes=Sizes(worlds=WORLDS, batch_steps=16, simulations=simulations, groups=64),
        worlds=settings.worlds(problem, truth),
        seed=settings.seed,
    )
    return Run(problem, trainer, truth)


if __name__ == "__main__":
    sys.exit(main("pendulum_pixels", build, __doc__, FilmedSettings))
