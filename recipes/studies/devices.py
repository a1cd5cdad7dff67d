"""Worlds and fits on the CPU and on a GPU: ``make devices`` -> docs/results/devices.json and devices.md.

| row    | what is done                                                                                              |
|--------|-----------------------------------------------------------------------------------------------------------|
| worlds | ``simulator.step`` under random commands, all worlds at once, in double precision; steps x worlds a second |
| fit    | epochs of ``fit``: a mixture of five Gaussians behind an embedding, 4000 trajectories of 50 steps          |

Rows of a GPU are left out where there is none.
"""

from __future__ import annotations

import itertools
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from tensordict import TensorDict

from envs.cartpole import CartPole
from envs.pendulum import Pendulum
from onlinebayes.embeddings import Embedding, LSTMEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.experiments import status
from onlinebayes.inference import BoxUniform, MixtureEstimator, NeuralPosteriorLoss, fit
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import Progress, ResultTable, seed_everything
from onlinebayes.simulators import TorchSimulator
from recipes.studies.timing import median, rate, spread

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
TRAJECTORIES, STEPS, OBSERVATION, ACTION = 4000, 50, 4, 2


@dataclass
class Settings:
    """Options of the measurements."""

    worlds: tuple[int, ...] = (4096, 65536)
    """numbers of worlds"""
    batches: tuple[int, ...] = (50, 1000)
    """trajectories of one gradient step"""
    seconds: float = 0.5
    """of each measurement of worlds [s]"""
    repeats: int = 3
    """measurements of a row of worlds"""
    epochs: int = 3
    """of each fit; another one before warms up"""
    threads: int = 0
    """of torch on the CPU; 0 for as many as there are cores"""
    seed: int = 0
    """of data and weights"""
    out: str = "docs/results"
    """folder of devices.json and devices.md"""


def wait(device: str) -> None:
    """Until what was asked of the device is done."""
    if device != "cpu":
        torch.cuda.synchronize()


def world_steps(system: type[TorchSimulator], worlds: int, device: str, seconds: float) -> float:
    """Steps a second, times the number of worlds."""
    simulator = system(SPACE, worlds, device=device)
    theta = BoxUniform(SPACE).sample((worlds,))
    command = 2 * torch.rand(worlds, len(simulator.commands), dtype=torch.float64, device=device) - 1
    inputs = TensorDict({"command": command}, batch_size=(worlds,), device=device)

    def advance() -> int:
        simulator.reset(theta)  # before poles turn so fast that worlds diverge
        for _ in range(50):
            simulator.step(inputs)
        wait(device)
        return 50 * worlds

    advance()
    return rate(advance, seconds)


def data(device: str) -> TensorDict:
    """Random trajectories: how long a step of learning takes does not depend on what is learnt."""
    path = torch.randn(TRAJECTORIES, STEPS + 1, OBSERVATION).cumsum(1)
    told = {
        "observation": path[:, :-1],
        "action": torch.randn(TRAJECTORIES, STEPS, ACTION),
        "next": {"observation": path[:, 1:]},
        "theta": BoxUniform(SPACE).sample((TRAJECTORIES,))[:, None].expand(-1, STEPS, -1),
    }
    return TensorDict(told, batch_size=(TRAJECTORIES, STEPS)).to(device)


EMBEDDINGS: dict[str, Callable[[TransitionFeatures], Embedding]] = {
    "averages": SummaryEmbedding,
    "LSTM": LSTMEmbedding,
}


def epoch_seconds(kind: str, batch: int, device: str, epochs: int) -> list[float]:
    """Of each epoch of a fit but the first, which warms up."""
    embedding = EMBEDDINGS[kind](TransitionFeatures(OBSERVATION, ACTION))
    loss = NeuralPosteriorLoss(embedding, MixtureEstimator(SPACE, embedding.size)).to(device)
    ends: list[float] = []
    fit(
        loss,
        data(device),
        generator=torch.Generator().manual_seed(0),
        epochs=1 + epochs,
        batch_size=batch,
        progress=lambda _epoch, _loss: ends.append(time.perf_counter()),  # the loss is on the host by then
    )
    return [after - before for before, after in itertools.pairwise(ends)]


def main(settings: Settings) -> None:
    """Measure and write the table."""
    torch.set_num_threads(settings.threads or len(os.sched_getaffinity(0)))
    seed_everything(settings.seed)
    devices = {"cpu": f"CPU, {torch.get_num_threads()} threads"}
    if torch.cuda.is_available():
        devices["cuda"] = torch.cuda.get_device_name()
    table = ResultTable("devices", "make devices", [settings.seed])
    systems: tuple[type[TorchSimulator], ...] = (CartPole, Pendulum)
    worlds = [(system, number) for system in systems for number in settings.worlds]
    fits = [(kind, batch) for kind in EMBEDDINGS for batch in settings.batches]
    with Progress("devices", (len(worlds) + len(fits)) * len(devices)) as progress:
        done = 0
        for system, number in worlds:
            for device, called in devices.items():
                found = [world_steps(system, number, device, settings.seconds) for _ in range(settings.repeats)]
                name = f"{system.__name__}, {number} worlds, {called}"
                table.add(name, median(found) / 1e6, spread=spread([x / 1e6 for x in found]), unit="million steps/s")
                progress.update(done := done + 1, name)
        for kind, batch in fits:
            for device, called in devices.items():
                found = epoch_seconds(kind, batch, device, settings.epochs)
                name = f"epoch of a fit, {kind}, batches of {batch}, {called}"
                table.add(name, median(found), spread=spread(found), unit="s")
                progress.update(done := done + 1, name)
    table.write(settings.out)
    print(table.to_markdown())


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
