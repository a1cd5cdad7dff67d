"""The interface of inference for a trainer, a plot and a calibration, whatever estimator stands behind it.

    estimator.fit(simulations, groups)            learn q(theta | x) from theta_i ~ proposal, x_i ~ simulator(theta_i)
    belief = estimator.condition(x_1 ... x_n)     p(theta | x_1 ... x_n) of one system
    belief.sample(shape), belief.log_prob(theta)

``onlinebayes.inference.testing.check_estimator`` says whether an estimator of your own keeps these promises.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.inference.alarm import Alarm
from onlinebayes.inference.distributions import Box
from onlinebayes.parameters import ParameterSpace


@runtime_checkable
class Density(Protocol):
    """Distributions over theta, a batch of them or one."""

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draw theta (*shape, *batch, P), float64 [SI]."""
        ...

    def log_prob(self, theta: Tensor) -> Tensor:
        """Natural log of the density at theta (*shape, *batch, P) [1 / units]; -inf outside the bounds."""
        ...


@runtime_checkable
class Belief(Density, Protocol):
    """One distribution over the parameters of a space: a prior, a posterior, a proposal."""

    @property
    def space(self) -> ParameterSpace:
        """The parameters."""
        ...

    @property
    def box(self) -> Box:
        """A box in the unit cube of the space outside of which the density is zero."""
        ...


@dataclass
class FitReport:
    """Losses and results of a fit: mean negative log densities (in the box's coordinates) an epoch.

    Attributes:
        train: training loss of each epoch; one for an estimator without epochs.
        validation: loss on held-out simulations of each epoch.
        best: the epoch whose weights were kept, from 0.
        widening: factor on the components' scales, found on the held-out trajectories.
        combination: factor on the scales where several trajectories are combined; inf for their union.
        seconds: time taken [s].
    """

    train: list[float] = field(default_factory=list)
    validation: list[float] = field(default_factory=list)
    best: int = 0
    widening: float = 1.0
    combination: float = 1.0
    seconds: float = 0.0


@runtime_checkable
class PosteriorEstimator(Protocol):
    """Learns from simulations what a trajectory tells of theta.

    Attributes:
        space: the parameters.
        box: where the simulations are drawn; the posterior is zero elsewhere.
    """

    space: ParameterSpace
    box: Box

    def fit(
        self, simulations: TensorDictBase, groups: TensorDictBase | None = None, *, generator: torch.Generator
    ) -> FitReport:
        """Learn.

        Args:
            simulations: trajectories (B, T) with their theta.
            groups: trajectories (G, n, T), n of each theta, for estimators that learn how n trajectories combine.
            generator: decides all random choices, so that a fit can be repeated.
        """
        ...

    def condition(self, trajectories: TensorDictBase) -> Belief:
        """Return the posterior given all trajectories (n, T) of one system."""
        ...

    def each(self, groups: TensorDictBase) -> Density:
        """G posteriors as one batch (G,), one for each group of n trajectories (G, n, T)."""
        ...


@runtime_checkable
class Tailed(Protocol):
    """An estimator that reads the ends of a series of trajectories faster than one by one."""

    def tails(self, trajectories: TensorDictBase, begins: Sequence[int]) -> list[Belief]:
        """For each number b what the trajectories (n, T) from b on, counted from 0, say together."""
        ...


@runtime_checkable
class Alarming(Protocol):
    """An estimator that can say whether a trajectory is like anything that was simulated."""

    def alarm(self, simulations: TensorDictBase) -> Alarm:
        """An alarm over these simulations (B, T)."""
        ...


@runtime_checkable
class Widenable(Protocol):
    """A network whose densities can be made wider by one factor, which a fit finds on held-out rows."""

    widening: Tensor


@runtime_checkable
class DensityBatch(Density, Protocol):
    """The densities that an estimator network gives for a batch of embeddings."""

    @property
    def batch_shape(self) -> torch.Size:
        """Shape of the batch."""
        ...

    def __getitem__(self, index: int) -> DensityBatch:
        """One of the batch."""
        ...

    def log_prob_frame(self, z: Float[Tensor, "*shape P"]) -> Tensor:
        """Log density in the coordinates of the estimator's box."""
        ...


@runtime_checkable
class ConditionalDensity(Protocol):
    """An estimator network (an ``nn.Module``): embedding -> density, zero outside its box."""

    space: ParameterSpace
    box: Box

    def distribution(self, embedding: Float[Tensor, "B E"]) -> DensityBatch:
        """The batch of densities that the embeddings stand for."""
        ...

    def united(self, factors: Sequence[Any]) -> Any:
        """The union of n such batches (*G,)."""
        ...


@runtime_checkable
class Multipliable(Protocol):
    """A network whose densities can be multiplied; of the others trajectories are combined by their union."""

    def multiplied(self, factors: Sequence[Any], widening: float = 1.0) -> Any:
        """The product of n such batches (*G,), each factor made wider first."""
        ...
