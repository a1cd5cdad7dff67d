"""Policies and values from specs: what every objective builds first.

    pi(a | s) = Categorical(softmax f(s))                              a discrete action, one-hot or an index
    pi(a | s) = low + (high - low) (1 + tanh u) / 2,  u ~ N(f(s), sigma(s)^2)   a bounded action

f is a multilayer perceptron on ``"observation"``. Any TensorDict module with the same keys may stand in its place.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.distributions import Categorical as CategoricalDistribution
from torchrl.data import Bounded, Categorical, OneHot, TensorSpec
from torchrl.modules import MLP, OneHotCategorical, ProbabilisticActor, TanhNormal, ValueOperator

from onlinebayes.runs import BadInput

OBSERVATION, ACTION = "observation", "action"
LOG_SCALE = (-5.0, 2.0)
"""Bounds of log sigma: a narrower policy gives gradients that explode, a wider one is uniform after the tanh."""


class LocationScale(nn.Module):
    """Split features (..., 2A) into the location (..., A) and the scale exp(.) (..., A) of a normal distribution."""

    def forward(self, features: Float[Tensor, "*batch A2"]) -> tuple[Tensor, Tensor]:
        """Location and scale; the scale's logarithm is clamped to :data:`LOG_SCALE`."""
        location, log_scale = features.chunk(2, -1)
        return location, log_scale.clamp(*LOG_SCALE).exp()


def stochastic_policy(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    widths: Sequence[int] = (64, 64),
    *,
    activation: type[nn.Module] = nn.Tanh,
    log_prob: bool = False,
) -> ProbabilisticActor:
    """A policy pi(a | s) from the leaf specs of one world (no batch axes).

    Args:
        observation_spec: shape (O,).
        action_spec: ``OneHot`` (A,), ``Categorical`` () or ``Bounded`` (A,).
        widths: units of each hidden layer.
        activation: between the layers.
        log_prob: whether each call also writes ``"action_log_prob"``, which importance ratios need.

    Raises:
        BadInput: an action of another kind.
    """
    if isinstance(action_spec, OneHot | Categorical):
        outputs, head, keys = action_spec.space.n, [], ["logits"]
        kind = OneHotCategorical if isinstance(action_spec, OneHot) else CategoricalDistribution
        settings = {}
    elif isinstance(action_spec, Bounded) and action_spec.ndim == 1:
        outputs, head, keys = 2 * action_spec.shape[-1], [LocationScale()], ["loc", "scale"]
        kind, settings = TanhNormal, {"low": action_spec.space.low, "high": action_spec.space.high}
    else:
        raise BadInput(
            f"an action spec of type {type(action_spec).__name__} and shape {tuple(action_spec.shape)}",
            "give the leaf spec of one world: OneHot (A,), Categorical () or Bounded (A,)",
        )
    network = mlp(observation_spec.shape[-1], outputs, widths, activation, observation_spec.device)
    module = TensorDictModule(nn.Sequential(network, *head), [OBSERVATION], keys)
    return ProbabilisticActor(
        module,
        in_keys=keys,
        out_keys=[ACTION],
        spec=action_spec,
        distribution_class=kind,
        distribution_kwargs=settings,
        return_log_prob=log_prob,
    )


def state_value(
    observation_spec: TensorSpec, widths: Sequence[int] = (64, 64), *, activation: type[nn.Module] = nn.Tanh
) -> ValueOperator:
    """V(s): ``"observation"`` (..., O) -> ``"state_value"`` (..., 1)."""
    network = mlp(observation_spec.shape[-1], 1, widths, activation, observation_spec.device)
    return ValueOperator(network, in_keys=[OBSERVATION])


def action_value(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    widths: Sequence[int] = (64, 64),
    *,
    activation: type[nn.Module] = nn.ReLU,
) -> ValueOperator:
    """Q(s, a): ``"observation"`` (..., O), ``"action"`` (..., A) -> ``"state_action_value"`` (..., 1)."""
    inputs = observation_spec.shape[-1] + action_spec.shape[-1]
    network = mlp(inputs, 1, widths, activation, observation_spec.device)
    return ValueOperator(network, in_keys=[OBSERVATION, ACTION])


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
