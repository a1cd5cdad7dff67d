"""The posterior over physical parameters given trajectories: an immutable distribution on the box.

One trajectory x gives q(theta | x). Several, of the same system:

    union      1/n sum_i q(theta | x_i)                          cautious: narrow proposals on this
    product    prop. to prod_i q_w(theta | x_i) / p(theta)^(n-1)   what they say together, p uniform on the box

The product is right if each q is; a slightly overconfident q is overconfident n times in it (in the first rounds of a
sequential run the truth lost 35 nats that way), so the union is the default. q_w is q with every scale times a factor
w; :class:`~onlinebayes.inference.NeuralEstimator` finds the w that held-out groups of trajectories ask for.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import SetEmbedding
from onlinebayes.inference.base import Belief, DensityBatch, Multipliable
from onlinebayes.inference.distributions import Box, BoxUniform, TruncatedMixture
from onlinebayes.inference.distributions.marginal import Marginal
from onlinebayes.inference.loss import NeuralPosteriorLoss
from onlinebayes.runs import BadInput


class Posterior:
    """Posterior of theta; conditioning gives a new posterior and leaves this one as it is.

    Args:
        loss: the trained loss; embedding, estimator and keys are copied out of it and frozen. Before
            :meth:`condition` the posterior is the uniform distribution on the box the estimator was trained in.
    """

    def __init__(self, loss: NeuralPosteriorLoss) -> None:
        self._loss = copy.deepcopy(loss).eval().requires_grad_(False)
        self.space = self._loss.estimator.space
        self.distribution: Belief = BoxUniform(self.space, self._loss.estimator.box)

    def condition(self, trajectories: TensorDictBase, *, combine: str = "union", widening: float = 1.0) -> Posterior:
        """The posterior given trajectories (B, T) of one system.

        Args:
            trajectories: with the loss's keys but theta; B = 1 for a single one.
            combine: ``"union"`` or ``"product"``, see the module; the same for B = 1, and for an embedding of sets,
                which reads all trajectories at once.
            widening: factor w on the scales of each factor of a product.

        Raises:
            ValueError: another ``combine``.
            BadInput: no trajectory, one without a recorded step, values that are not finite or of another width than
                the embedding's, or the product of densities that have none in closed form (flows). One unlike
                anything simulated is not noticed here: :class:`~onlinebayes.inference.Alarm` is asked for that. One
                much shorter or longer is, in a warning on this package's logger.
        """
        if combine not in ("union", "product"):
            raise ValueError(f"combine = '{combine}' is unknown; use 'union' or 'product'")
        if isinstance(self._loss.embedding, SetEmbedding):
            together = self.of_sets(trajectories.unsqueeze(0))[0]
            return self._with(self._loss.estimator.united([together]))
        batch, estimator = self.each(trajectories), self._loss.estimator
        factors = [batch[i] for i in range(batch.batch_shape[0])]
        if combine == "union":
            return self._with(estimator.united(factors))
        if not isinstance(estimator, Multipliable):
            raise BadInput(
                f"combine = 'product': the densities of {type(estimator).__name__} have no product in closed form",
                "use combine='union'",
            )
        return self._with(estimator.multiplied(factors, widening))

    @torch.no_grad()
    def each(self, trajectories: TensorDictBase) -> DensityBatch:
        """One density a trajectory, as a batch (B,): for calibration, where each has a theta of its own."""
        self._loss.mind_lengths(trajectories)
        return self._loss.estimator.distribution(self._loss.embed(trajectories))

    @torch.no_grad()
    def of_sets(self, groups: TensorDictBase) -> DensityBatch:
        """One density for each of G sets of trajectories (G, n, T), by an embedding of sets."""
        self._loss.mind_lengths(groups)
        return self._loss.estimator.distribution(self._loss.embed(groups))

    def sample(
        self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None
    ) -> Float[Tensor, "*shape P"]:
        """Theta (*shape, P) in SI units, float64."""
        return self.distribution.sample(shape, generator)

    def log_prob(self, theta: Float[Tensor, "*batch P"]) -> Float[Tensor, "*batch"]:
        """Natural log of the density on the original scale [1 / units]; -inf outside the box."""
        return self.distribution.log_prob(theta)

    def marginal(self, names: Sequence[str]) -> Marginal:
        """The distribution of some of the parameters, the others integrated out; of a mixture or a uniform one."""
        if not isinstance(self.distribution, TruncatedMixture | BoxUniform):
            raise ValueError(f"{type(self.distribution).__name__} has no marginals in closed form; use its draws")
        return Marginal(self.distribution, names)

    def mean(self, samples: int = 10_000) -> Float[Tensor, " P"]:
        """Posterior mean [units], by Monte Carlo with a fixed seed."""
        return self._fixed(samples).mean(0)

    def quantiles(self, levels: Sequence[float], samples: int = 10_000) -> Float[Tensor, "Q P"]:
        """Quantiles of each parameter [units], by Monte Carlo with a fixed seed."""
        points = self._fixed(samples)
        return torch.quantile(points, torch.as_tensor(levels, dtype=points.dtype, device=points.device), dim=0)

    def _fixed(self, samples: int) -> Tensor:
        return self.sample((samples,), torch.Generator().manual_seed(0))

    @property
    def box(self) -> Box:
        """The box outside of which the density is zero."""
        return self.distribution.box

    def _with(self, distribution: Belief) -> Posterior:
        result = copy.copy(self)
        result.distribution = distribution
        return result
