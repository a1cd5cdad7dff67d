"""One round of inference on a recipe's system, without its trainer: simulations of an untrained policy, and judges.

    theta_i ~ prior,  x_i ~ simulator(theta_i)          to fit on (B, T)
    theta_g ~ prior,  x_gj, j = 1 ... n                 to combine by, and to judge by (G, n, T)

and the estimators that studies compare on it, by name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import ModuleType

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import (
    Embedding,
    FilteredEmbedding,
    SimulatorReference,
    SummaryEmbedding,
    TransitionFeatures,
)
from onlinebayes.experiments import Settings
from onlinebayes.inference import (
    FlowEstimator,
    FourierFeatures,
    MixtureEstimator,
    NeuralEstimator,
    NeuralPosteriorLoss,
    PosteriorEstimator,
    RejectionABC,
    filter_of,
    fit,
    length_scales,
)
from onlinebayes.trainers import Problem, Simulations
from onlinebayes.trainers.trajectories import Policy
from recipes import acrobot, cartpole, mountain_car, pendulum

TASKS: dict[str, ModuleType] = {
    "pendulum": pendulum,
    "cartpole": cartpole,
    "mountain_car": mountain_car,
    "acrobot": acrobot,
}
FEATURES = 500
TRAIN = partial(fit, epochs=25, batch_size=50, learning_rate=4e-3)
SLOW_TRAIN = partial(fit, epochs=25, batch_size=50, learning_rate=1e-3)
"""For a network in the filter's units, which has little left to learn."""


@dataclass(frozen=True)
class OneRound:
    """A recipe's system and an untrained policy.

    Args:
        problem: system, prior, sensors.
        state: observations -> states, the recipe's.
        policy: untrained.
        steps: of a trajectory.
        seed: of all worlds.
    """

    problem: Problem
    state: Callable[[Tensor], TensorDict]
    policy: Policy
    steps: int
    seed: int

    @classmethod
    def of(cls, task: str, seed: int, noise: float) -> OneRound:
        """Build the round of a recipe.

        Args:
            task: which of :data:`TASKS`.
            seed: of policy and worlds.
            noise: of the sensors, as a share of each range.
        """
        made = TASKS[task].build(Settings(seed=seed, noise=noise))
        steps = made.trainer.schedule.real_steps
        return cls(made.problem, TASKS[task].state, made.trainer.objective.policy, steps, seed)

    def worlds(self, number: int, which: int) -> Simulations:
        """Worlds of their own random numbers, ``which`` = 1, 2, ..."""
        return self.problem.simulations(number, self.steps, self.seed + which)

    def simulated(self, number: int, which: int = 1) -> TensorDict:
        """Single trajectories (B, T)."""
        return self.worlds(number, which).draw([self.policy], self.problem.prior)

    def groups(self, number: int, n: int, which: int) -> TensorDict:
        """Sets of n trajectories of one theta each (G, n, T)."""
        return self.worlds(number, which).groups([self.policy] * n, self.problem.prior)

    def features(self) -> TransitionFeatures:
        """Transitions beside the simulator's own, as ``residual_estimator`` has them."""
        simulator, task, box = self.problem.simulator, self.problem.task, self.problem.prior.box
        reference = SimulatorReference(
            simulator, box.cross(), state=self.state, command=task.command, observe=task.observe
        )
        return TransitionFeatures(
            task.observation_size,
            task.action_spec.shape[-1],
            reference=reference,
            sensitivities=len(simulator.parameters),
        )

    def filtered(self) -> FilteredEmbedding:
        """The filter through the simulator."""
        problem = self.problem
        model = filter_of(problem.simulator, problem.task, problem.prior.box, state=self.state)
        return FilteredEmbedding(model, problem.task.action_spec.shape[-1])


def mixture(one: OneRound, embedding: Embedding) -> NeuralEstimator:
    """A mixture density network behind an embedding."""
    prior, located = one.problem.prior, isinstance(embedding, FilteredEmbedding)
    network = MixtureEstimator(prior.space, embedding.size, box=prior.box, located=located)
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), SLOW_TRAIN if located else TRAIN)


def fourier(one: OneRound, simulations: TensorDictBase) -> NeuralEstimator:
    """The same on Fourier features, their length scale the median distance between summaries."""
    prior, embedding = one.problem.prior, SummaryEmbedding(one.features())

    def loss(length_scale: float) -> NeuralPosteriorLoss:
        trunk = FourierFeatures(embedding.size, FEATURES, length_scale=length_scale)
        network = MixtureEstimator(prior.space, embedding.size, hidden=FEATURES, trunk=trunk, box=prior.box)
        return NeuralPosteriorLoss(embedding, network)

    return NeuralEstimator(loss(length_scales(loss(1.0), simulations, [1.0])[0]), TRAIN)


def flow(one: OneRound, kind: str) -> NeuralEstimator:
    """A normalising flow on the summary."""
    prior, embedding = one.problem.prior, SummaryEmbedding(one.features())
    network = FlowEstimator(prior.space, embedding.size, kind=kind, box=prior.box)  # type: ignore[arg-type]
    return NeuralEstimator(NeuralPosteriorLoss(embedding, network), SLOW_TRAIN)


def rejection(one: OneRound) -> RejectionABC:
    """The nearest simulations, adjusted."""
    prior = one.problem.prior
    return RejectionABC(SummaryEmbedding(one.features()), prior.space, box=prior.box, share=0.1, adjusted=True)


ESTIMATORS: dict[str, Callable[[OneRound, TensorDictBase], PosteriorEstimator]] = {
    "filter, mixture": lambda one, _: mixture(one, one.filtered()),
    "summary, mixture": lambda one, _: mixture(one, SummaryEmbedding(one.features())),
    "summary, Fourier features": fourier,
    "summary, spline flow": lambda one, _: flow(one, "nsf"),
    "summary, affine flow": lambda one, _: flow(one, "maf"),
    "summary, rejection": lambda one, _: rejection(one),
}
"""Name -> (system, simulations) -> a fresh estimator."""


def begun(seed: int) -> torch.Generator:
    """The generator of one job; networks begin alike in every job of a seed."""
    torch.manual_seed(seed)
    return torch.Generator().manual_seed(seed)
