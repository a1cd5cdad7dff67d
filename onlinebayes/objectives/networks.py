"""Policies and values from specs: what every objective builds first.

    pi(a | s) = Categorical(softmax f(s))                              a discrete action, one-hot or an index
    pi(a | s) = low + (high - low) (1 + tanh u) / 2,  u ~ N(f(s), sigma(s)^2)   a bounded action

f is a multilayer perceptron on the observed keys. Any TensorDict module with the same keys may stand in its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from tensordict import NestedKey
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.distributions import Categorical as CategoricalDistribution
from torchrl.data import Bounded, Categorical, OneHot, TensorSpec
from torchrl.modules import MLP, OneHotCategorical, ProbabilisticActor, TanhNormal, ValueOperator

from onlinebayes.objectives.inputs import KEYS, Inputs, inputs_of
from onlinebayes.runs import BadInput

LOG_SCALE = (-5.0, 2.0)
"""Bounds of log sigma: a narrower policy gives gradients that explode, a wider one is uniform after the tanh."""


class LocationScale(nn.Module):
    """Split features (..., 2A) into the location (..., A) and the scale exp(.) (..., A) of a normal distribution."""

    def forward(self, features: Float[Tensor, "*batch A2"]) -> tuple[Tensor, Tensor]:
        """Location and scale; the scale's logarithm is clamped to :data:`LOG_SCALE`."""
        location, log_scale = features.chunk(2, -1)
        return location, log_scale.clamp(*LOG_SCALE).exp()


class Network(nn.Module):
    """A body on the observed values of a world.

    Args:
        inputs: the values as one row; may be shared by several networks.
        body: row (..., F) -> what is wanted.
        extra: number of further arguments (an action), appended to the row as they are.
    """

    def __init__(self, inputs: Inputs, body: nn.Module, extra: int = 0) -> None:
        super().__init__()
        self.inputs, self.body, self._extra = inputs, body, extra

    def forward(self, *values: Tensor) -> Any:
        """The body's answer."""
        if not self._extra:
            return self.body(self.inputs(*values))
        row = self.inputs(*values[: -self._extra])
        return self.body(torch.cat([row, *(value.to(row) for value in values[-self._extra :])], dim=-1))


class Scaled(nn.Module):
    """Actions in units of their bounds, -1 .. 1, to actions between ``low`` and ``high`` (A,)."""

    centre: Tensor
    halfwidth: Tensor

    def __init__(self, low: Float[Tensor, " A"], high: Float[Tensor, " A"]) -> None:
        super().__init__()
        self.register_buffer("centre", (high + low) / 2, persistent=False)
        self.register_buffer("halfwidth", (high - low) / 2, persistent=False)

    def forward(self, unit: Float[Tensor, "*batch A"]) -> Float[Tensor, "*batch A"]:
        """The action."""
        return self.centre + self.halfwidth * unit


def stochastic_policy(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    widths: Sequence[int] = (64, 64),
    *,
    in_keys: Sequence[NestedKey] = KEYS,
    activation: type[nn.Module] = nn.Tanh,
    log_prob: bool = False,
    inputs: Inputs | None = None,
    action_key: NestedKey = "action",
) -> ProbabilisticActor:
    """A policy pi(a | s) from the specs of one world (no batch axes).

    Args:
        observation_spec: shape (O,), or a Composite that holds every key.
        action_spec: ``OneHot`` (A,), ``Categorical`` () or ``Bounded`` (A,).
        widths: units of each hidden layer.
        in_keys: what the policy sees, joined in order.
        activation: between the layers.
        log_prob: whether each call also writes ``"action_log_prob"``, which importance ratios need.
        inputs: shared with other networks; built from the spec without it.
        action_key: where the action goes.

    Raises:
        BadInput: an action of another kind, or a key that the spec lacks.
    """
    inputs = inputs if inputs is not None else inputs_of(observation_spec, in_keys)
    head = action_head(action_spec)
    body = mlp(inputs.width, head.outputs, widths, activation, observation_spec.device)
    network = Network(inputs, nn.Sequential(body, *head.modules))
    module = TensorDictModule(network, list(inputs.keys), list(head.keys))
    return head.actor(module, action_spec, action_key=action_key, log_prob=log_prob)


@dataclass(frozen=True)
class ActionHead:
    """Map from a network's outputs to a distribution over actions.

    Args:
        outputs: numbers that the network gives.
        modules: what follows the network.
        keys: of the distribution's parameters.
        distribution: their distribution.
        settings: its further arguments.
    """

    outputs: int
    modules: tuple[nn.Module, ...]
    keys: tuple[str, ...]
    distribution: type[torch.distributions.Distribution]
    settings: Mapping[str, Any]

    def actor(
        self, module: TensorDictModule, action_spec: TensorSpec, *, action_key: NestedKey, log_prob: bool = False
    ) -> ProbabilisticActor:
        """A policy around a module that writes :attr:`keys`."""
        return ProbabilisticActor(
            module,
            in_keys=list(self.keys),
            out_keys=[action_key],
            spec=action_spec,
            distribution_class=self.distribution,
            distribution_kwargs=dict(self.settings),
            return_log_prob=log_prob,
        )


def action_head(action_spec: TensorSpec) -> ActionHead:
    """The head for an action of one world.

    Raises:
        BadInput: neither ``OneHot`` (A,) nor ``Categorical`` () nor ``Bounded`` (A,).
    """
    if isinstance(action_spec, OneHot) and action_spec.ndim == 1:
        return ActionHead(action_spec.space.n, (), ("logits",), OneHotCategorical, {})
    if isinstance(action_spec, Categorical) and action_spec.ndim == 0:
        return ActionHead(action_spec.space.n, (), ("logits",), CategoricalDistribution, {})
    if isinstance(action_spec, Bounded) and action_spec.ndim == 1:
        settings = {"low": action_spec.space.low, "high": action_spec.space.high}
        return ActionHead(2 * action_spec.shape[0], (LocationScale(),), ("loc", "scale"), TanhNormal, settings)
    raise unsupported(action_spec, "OneHot (A,), Categorical () or Bounded (A,)")


def state_value(
    observation_spec: TensorSpec,
    widths: Sequence[int] = (64, 64),
    *,
    in_keys: Sequence[NestedKey] = KEYS,
    activation: type[nn.Module] = nn.Tanh,
    inputs: Inputs | None = None,
) -> ValueOperator:
    """V(s): observed values -> ``"state_value"`` (..., 1)."""
    inputs = inputs if inputs is not None else inputs_of(observation_spec, in_keys)
    body = mlp(inputs.width, 1, widths, activation, observation_spec.device)
    return ValueOperator(Network(inputs, body), in_keys=list(inputs.keys))


def action_value(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    widths: Sequence[int] = (64, 64),
    *,
    in_keys: Sequence[NestedKey] = KEYS,
    activation: type[nn.Module] = nn.ReLU,
    inputs: Inputs | None = None,
    action_key: NestedKey = "action",
) -> ValueOperator:
    """Q(s, a): observed values, ``"action"`` (..., A) -> ``"state_action_value"`` (..., 1)."""
    inputs = inputs if inputs is not None else inputs_of(observation_spec, in_keys)
    body = mlp(inputs.width + action_spec.shape[-1], 1, widths, activation, observation_spec.device)
    return ValueOperator(Network(inputs, body, extra=1), in_keys=[*inputs.keys, action_key])


def unsupported(action_spec: TensorSpec, wanted: str) -> BadInput:
    """The error for an action that an objective has no policy for."""
    return BadInput(
        f"an action spec of type {type(action_spec).__name__} and shape {tuple(action_spec.shape)}",
        f"give the leaf spec of one world: {wanted}",
    )


def mlp(
    inputs: int,
    outputs: int,
    widths: Sequence[int],
    activation: type[nn.Module],
    device: torch.device | str | None = None,
) -> MLP:
    """A multilayer perceptron (..., inputs) -> (..., outputs)."""
    return MLP(
        in_features=inputs, out_features=outputs, num_cells=list(widths), activation_class=activation, device=device
    )
