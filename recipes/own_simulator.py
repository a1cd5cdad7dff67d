"""A simulator of your own, a plain function: the posterior of its parameters, how far to trust it, a plot, a file.

    python -m recipes.own_simulator [--seed S] [--push N] [--short]      a minute

The system is a cart on a spring, pushed for five seconds. Replace ``simulate`` and ``SPACE`` by your own; nothing else
knows of a cart. With ``--push 0`` the cart only swings, and no log of that tells more than ratios of its parameters.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.embeddings import JoinedEmbedding, LSTMEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.experiments import Options, closing_line, hidden_truth, place_of, status
from onlinebayes.inference import (
    Alarm,
    BoxUniform,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    fit,
    identifiability,
    plots,
    saving,
    trust,
)
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import seed_everything
from onlinebayes.trainers import Journal

SPACE = ParameterSpace(
    {
        "mass": Parameter(0.5, 2.0, "kg", "log"),
        "stiffness": Parameter(2.0, 20.0, "N/m", "log"),
        "damping": Parameter(0.1, 2.0, "N s/m", "log"),
    }
)
STEPS, DT, NOISE = 50, 0.1, 0.005  # of a run, [s], of both readings [m, m/s]


@dataclass(frozen=True)
class Settings(Options):
    """One run."""

    push: float = 3.0
    """largest force on the cart [N]"""


def simulate(theta: np.ndarray, push: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Readings of position and speed (B, T + 1, 2) at theta (B, 3) under forces (B, T), from 0.3 m and rest."""
    mass, stiffness, damping = theta.T
    x, v = np.full(len(theta), 0.3), np.zeros(len(theta))
    states = [np.stack([x, v], -1)]
    for force in push.T.repeat(5, 0):
        v = v + DT / 5 * (force - stiffness * x - damping * v) / mass
        x = x + DT / 5 * v
        states.append(np.stack([x, v], -1))
    seen = np.stack(states[::5], 1)
    return seen + NOISE * random.standard_normal(seen.shape)


def trajectories(theta: Tensor, push: float, random: np.random.Generator) -> TensorDict:
    """Runs of the function at theta (B, 3), each with forces of its own, laid out as TorchRL lays out trajectories."""
    forces = push * random.uniform(-1, 1, (len(theta), STEPS))
    seen = torch.tensor(simulate(theta.numpy(), forces, random), dtype=torch.float32)
    action = torch.tensor(forces[..., None], dtype=torch.float32)
    told = {"observation": seen[:, :-1], "action": action, "next": {"observation": seen[:, 1:]}}
    return TensorDict({**told, "theta": theta[:, None].expand(-1, STEPS, -1)}, [len(theta), STEPS])


def main(settings: Settings) -> int:
    """Infer, ask whether to trust it, keep it; returns the exit status."""
    seed_everything(settings.seed)
    place, prior = place_of("own_simulator", settings), BoxUniform(SPACE)
    number, epochs = (500, 10) if settings.short else (2000, 25)
    truth = hidden_truth(SPACE, settings.seed, {"mass": 1.0, "stiffness": 8.0, "damping": 0.5})
    random, generator = np.random.default_rng(settings.seed), torch.Generator().manual_seed(settings.seed)
    made = partial(trajectories, push=settings.push, random=random)

    features = TransitionFeatures(observation=2, action=1)
    embedding = JoinedEmbedding([LSTMEmbedding(features, 16), SummaryEmbedding(features)])
    network = MixtureEstimator(SPACE, embedding.size)
    estimator = NeuralEstimator(NeuralPosteriorLoss(embedding, network), partial(fit, epochs=epochs))
    with Journal(place, "own_simulator", prior, truth=truth) as journal:
        simulated = made(prior.sample((number,), generator))
        estimator.fit(simulated, generator=generator)
        measured = made(truth[None]).exclude("theta")  # stands for the log of your machine
        posterior = estimator.condition(measured)
        gain = float(posterior.log_prob(truth) - prior.log_prob(truth))
        journal.step("belief", simulated=simulated.numel(), belief=posterior, figures={"gain": gain})

    surprise = Alarm(embedding, simulated).check(measured)
    print(f"like the simulations: p = {surprise.p:.2g}")
    theta = prior.sample((200,), generator)
    print(trust.in_words(lambda x: estimator.each(x[:, None]), theta, made(theta), SPACE, generator=generator))
    print(identifiability(posterior, prior.box))
    plots.save(plots.corner(posterior, truth=truth, prior=prior), place / "corner.png")
    saving.save(posterior, place / "posterior.json")  # posterior = saving.load(...)
    print(f"the truth gains {gain:.1f} nats over the prior")
    print(closing_line(place))
    return 0 if gain > 0 and not surprise else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
