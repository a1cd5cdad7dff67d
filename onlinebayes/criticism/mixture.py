"""Worlds to train a policy in: all hypotheses that the logs leave open, as one simulator and draws of its parameters.

    theta ~ sum_k w_k N(mean_k, covariance_k),     cut off at the bounds

The simulator has the additions of all hypotheses. In a world of one of them, those of the others are neutral. A
parameter that differs between runs is drawn around the mean of its values, with their spread; one that differs between
units as the next unit's (:mod:`.unit_prior`): the normal distribution of the same 90 % interval.

    result = refine(...)
    worlds = worlds_of(result)
    problem = Problem(worlds.simulator, task, prior=worlds.belief)      # the trainer goes on from what the logs said
    env = TransformedEnv(SimulatorEnv(worlds.simulator.with_worlds(64), task), ParameterRandomization(worlds))
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.findings.fleets import fleets_of
from onlinebayes.criticism.results import WeightedModel
from onlinebayes.identification.replaying.scoped import unscoped
from onlinebayes.identification.results import FittedModel
from onlinebayes.identification.scope import address_of
from onlinebayes.inference import Box, TruncatedMixture
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

NEUTRAL = 1e-3
"""Sd, as a share of its range, that stands for an addition that a model lacks."""

CERTAIN = 1e-6
"""Of its range: a parameter with a smaller sd is one that the model lacks."""


@dataclass(frozen=True, eq=False)
class ModelMixture:
    """K weighted models in one simulator; their numbers lie on the CPU.

    Args:
        simulator: with the additions of all.
        names: what each model adds.
        weight: w.
        mean: of theta [SI].
        covariance: of theta [SI].
    """

    simulator: Identifiable
    names: tuple[str, ...]
    weight: Float[Tensor, " K"]
    mean: Float[Tensor, "K P"]
    covariance: Float[Tensor, "K P P"]

    @property
    def space(self) -> ParameterSpace:
        """The parameters."""
        return self.simulator.parameters

    def sample(self, shape: tuple[int, ...] = (), generator: torch.Generator | None = None) -> Tensor:
        """Draws of theta (*shape, P), float64 [SI]."""
        number = int(torch.Size(shape).numel())
        which = torch.multinomial(self.weight, number, replacement=True, generator=generator)
        normal = torch.randn(number, self.mean.shape[1], generator=generator, dtype=torch.float64)
        drawn = self.mean[which] + (_roots(self.covariance)[which] @ normal[..., None])[..., 0]
        return self.space.clamp(drawn).reshape(*shape, -1)

    @property
    def belief(self) -> TruncatedMixture:
        """The same as a density over the simulator's bounds: a prior for the trainer.

        An addition that a model lacks has an sd of a thousandth of its range there, for a density needs a width.
        """
        return density(self.space, self.weight, self.mean, self.covariance)

    def alone(self, k: int) -> ModelMixture:
        """The worlds of one of the models."""
        only = slice(k, k + 1)
        weight = torch.ones(1, dtype=torch.float64)
        return ModelMixture(self.simulator, self.names[only], weight, self.mean[only], self.covariance[only])


def worlds_of(result: Criticism) -> ModelMixture:
    """The worlds of a result: of its final model, and of those that the data cannot tell from it.

    Raises:
        BadInput: the additions of two hypotheses cannot stand beside each other in one simulator.
    """
    return mixture_of(result.base.simulator, result.hypotheses)


def mixture_of(base: Identifiable, believed: Sequence[WeightedModel]) -> ModelMixture:
    """The worlds of weighted models of one machine.

    Args:
        base: a simulator whose effects and free numbers all of them have.
        believed: the models; each one's simulator, theta and covariance are read.

    Raises:
        BadInput: the additions of two models cannot stand beside each other in one simulator.
    """
    simulator = joined(unscoped(base), [one.model.simulator for one in believed])
    parts = [embedded(simulator, one.model) for one in believed]
    return ModelMixture(
        simulator,
        tuple(" + ".join(one.accepted) or "the model as it is" for one in believed),
        torch.tensor([one.weight for one in believed], dtype=torch.float64),
        torch.stack([mean for mean, _ in parts]),
        torch.stack([covariance for _, covariance in parts]),
    )


def moments_of(model: FittedModel) -> tuple[ParameterSpace, Float[Tensor, " Q"], Float[Tensor, "Q Q"]]:
    """The parameters of a model's own simulator in the next run or unit: names and bounds, mean, covariance [SI]."""
    simulator = unscoped(model.simulator)
    return simulator.parameters, *embedded(simulator, model)


def joined(simulator: Identifiable, models: Sequence[Identifiable]) -> Identifiable:
    """The simulator with the effects, the free numbers and the widest bounds of all models.

    Raises:
        BadInput: the effects of two of them cannot stand beside each other.
    """
    for model in map(unscoped, models):
        present = {effect.key for effect in simulator.effects}
        for effect in model.effects:
            if effect.key not in present:
                simulator = simulator.with_effect(effect)
        for name, bounds in model.parameters.items():
            if name not in simulator.parameters:
                simulator = simulator.with_free(name, bounds)
            elif (wide := _wider(simulator.parameters[name], bounds)) != simulator.parameters[name]:
                simulator = simulator.with_bounds(name, wide)
    return simulator


def _wider(one: Parameter, other: Parameter) -> Parameter:
    return Parameter(min(one.low, other.low), max(one.high, other.high), one.unit, one.scale)


def density(
    space: ParameterSpace, weight: Float[Tensor, " K"], mean: Float[Tensor, "K P"], covariance: Float[Tensor, "K P P"]
) -> TruncatedMixture:
    """The mixture of normal distributions of theta [SI], as one over the bounds of the space."""
    theta = space.clamp(mean).detach().clone().requires_grad_()
    u = space.to_unit(theta)
    (slope,) = torch.autograd.grad(u.sum(), theta)
    covariance = slope[:, :, None] * covariance * slope[:, None, :]
    spread = covariance.diagonal(dim1=1, dim2=2)
    least = torch.where(spread < CERTAIN**2, torch.full_like(spread, NEUTRAL**2), CERTAIN**2)
    roots = _lower(covariance + torch.diag_embed(least))
    return TruncatedMixture(weight.log(), u.detach(), roots, Box.whole(space))


def _lower(covariance: Float[Tensor, "K P P"]) -> Float[Tensor, "K P P"]:
    """Return Cholesky's factors; of what rounding has made indefinite, of the nearest matrix that is not."""
    roots, failed = torch.linalg.cholesky_ex(covariance)
    if not bool(failed.any()):
        return roots
    values, vectors = torch.linalg.eigh((covariance + covariance.mT) / 2)
    floor = CERTAIN**2 * values.amax(-1, keepdim=True).clamp_min(1.0)
    return torch.linalg.cholesky(vectors @ torch.diag_embed(values.maximum(floor)) @ vectors.mT)


def embedded(simulator: Simulator, model: FittedModel) -> tuple[Float[Tensor, " P"], Float[Tensor, "P P"]]:
    """Mean and covariance of a model in the parameters of all; the others' additions are neutral and certain."""
    fleets = fleets_of(model)
    mean = simulator.nominal.to("cpu", torch.float64).clone()
    move, spread = mean.new_zeros(len(mean), len(model.theta)), torch.zeros_like(mean)
    for i, columns in _places(simulator, model):
        own = model.theta[columns].to(mean)
        if fleet := fleets.get(simulator.parameters.names[i]):
            mean[i], spread[i] = fleet.next.mean, fleet.next.sd**2
            continue
        move[i, columns] = 1 / len(columns)
        mean[i], spread[i] = own.mean(), own.var(correction=0)
    covariance = move @ model.covariance.to(mean) @ move.T + torch.diag(spread)
    return simulator.parameters.clamp(mean), covariance


def _places(simulator: Simulator, model: FittedModel) -> Iterator[tuple[int, list[int]]]:
    """Each parameter that a model has, and the columns of its theta that hold values of it."""
    of = [address_of(name) for name in model.simulator.parameters]
    for i, name in enumerate(simulator.parameters):
        if columns := [k for k, address in enumerate(of) if address == name]:
            yield i, columns


def _roots(covariance: Float[Tensor, "K P P"]) -> Float[Tensor, "K P P"]:
    """Square roots, of singular matrices too; what has no variance stays exactly where it is."""
    values, vectors = torch.linalg.eigh(covariance)
    varies = covariance.diagonal(dim1=1, dim2=2) > 0
    return vectors * values.clamp_min(0).sqrt()[:, None, :] * varies[:, :, None]
