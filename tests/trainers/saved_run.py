"""A small run of which each version saves the first step before it is released: later versions go on with it.

python -m tests.trainers.saved_run        writes tests/fixtures/saved_runs/VERSION, once for each release
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import torch

import onlinebayes
from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.embeddings import SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import BoxUniform, Gate, MixtureEstimator, NeuralEstimator, NeuralPosteriorLoss, fit
from onlinebayes.objectives import PPOSettings, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import RunFolder, seed_everything
from onlinebayes.trainers import (
    OnlineState,
    OnlineTrainer,
    PolicyFiles,
    Problem,
    Schedule,
    Sizes,
    online_trainer,
    run_in_folder,
)

SAVED = Path(__file__).parents[1] / "fixtures" / "saved_runs"
NAME = "saved"
SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
PRIOR = BoxUniform(SPACE)


def estimator(proposal) -> NeuralEstimator:
    """A mixture of two Gaussians behind eight hidden units."""
    embedding = SummaryEmbedding(TransitionFeatures(4, 2))
    network = MixtureEstimator(SPACE, embedding.size, components=2, hidden=8, box=proposal.box)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=2, batch_size=20))


def build(steps: int) -> tuple[Problem, OnlineTrainer]:
    """The whole composition, as small as it goes."""
    seed_everything(0)
    problem = Problem(CartPole(SPACE), CartPoleTask(), PRIOR)
    objective = ppo(*problem.specs, PPOSettings(widths=(8,), minibatch=32, epochs=1))
    trainer = online_trainer(
        problem,
        objective,
        estimator=estimator,
        real=problem.hidden(torch.tensor([0.4, 0.3], dtype=torch.float64), 7),
        schedule=Schedule(steps, 1, real_steps=10),
        sizes=Sizes(worlds=2, batch_steps=16, simulations=40, groups=8),
        gate=Gate(narrows=False),  # a narrowed proposal keeps 300 kB
        seed=0,
    )
    return problem, trainer


def played(folder: Path, steps: int) -> OnlineState:
    """Begin or go on with the run in a folder, until so many steps are done."""
    problem, trainer = build(steps)
    files = PolicyFiles(folder, NAME, trainer.objective, problem)
    with RunFolder(folder, NAME) as place:
        return run_in_folder(trainer, PRIOR, place, judge=lambda _state: {"return": 1.0}, watchers=(files,))


def write() -> int:
    """Write the run of this version.

    Raises:
        FileExistsError: it is there: what was released stays as it was released.
    """
    folder = SAVED / onlinebayes.__version__
    if folder.exists():
        raise FileExistsError(folder)
    played(folder, 1)
    *earlier, _ = sorted(folder.glob("checkpoint-*.pt"))
    for path in (
        *earlier,
        *(path.with_suffix(".json") for path in earlier),
        folder / ".lock",
        *(folder / "best").iterdir(),
    ):
        path.unlink()
    (folder / "best").rmdir()
    print(f"written: {folder}")
    return 0


if __name__ == "__main__":
    sys.exit(write())
