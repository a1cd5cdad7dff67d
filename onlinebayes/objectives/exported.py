"""A trained policy as plain arrays: the network behind its deterministic action, taken out of torch's modules.

    policy = actor (keys -> parameters), then a distribution or an exploration, which act only while it learns

What has no counterpart in :mod:`onlinebayes.policies` is refused by name: a planner, a layer of another kind, another
distribution.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import NestedKey
from tensordict.nn import ProbabilisticTensorDictModule, TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torch.distributions import Categorical as CategoricalDistribution
from torchrl.modules import NormalParamExtractor, OneHotCategorical, TanhNormal

from onlinebayes.objectives.exploration import Exploration
from onlinebayes.objectives.inputs import Inputs
from onlinebayes.objectives.networks import LocationScale, Network, Scaled
from onlinebayes.objectives.recurrent_network import RecurrentNetwork
from onlinebayes.policies import Layer, Memory, Normalisation, Origin, PolicyNetwork, card_of, write_policy
from onlinebayes.runs import BadInput

ACTIVATIONS: dict[type[nn.Module], str] = {
    nn.ELU: "elu",
    nn.LeakyReLU: "leaky_relu",
    nn.ReLU: "relu",
    nn.Sigmoid: "sigmoid",
    nn.SiLU: "silu",
    nn.Tanh: "tanh",
}
DISCRETE = {OneHotCategorical: "one-hot", CategoricalDistribution: "index"}


def save_policy(folder: str | Path, policy: nn.Module, origin: Origin) -> None:
    """Write ``policy.safetensors`` and ``policy.md``, which ``onlinebayes.load_policy`` reads.

    Args:
        folder: where they go.
        policy: of an objective, or a TorchRL actor of linear layers.
        origin: where it comes from.

    Raises:
        BadInput: a policy that cannot be exported, or the files cannot be written.
    """
    network = exported(policy)
    write_policy(folder, network, card_of(network, origin))


def exported(policy: nn.Module) -> PolicyNetwork:
    """The network behind a policy's deterministic action.

    Raises:
        BadInput: a policy that numpy cannot compute; says which part.
    """
    first, *others = _parts(policy)
    if not isinstance(first, TensorDictModule):
        raise _refused(type(policy).__name__)
    distribution: type[Any] | None = None
    settings: dict[str, Any] = {}
    for part in others:
        if isinstance(part, ProbabilisticTensorDictModule):
            distribution, settings = part.distribution_class, dict(part.distribution_kwargs)
        elif not (isinstance(part, TensorDictModule) and isinstance(part.module, Exploration)):
            raise _refused(_name(part))
    return _network(first, _Head(distribution, settings))


class _Head:
    """The step from the outputs of a policy's network to its action.

    Args:
        distribution: over actions; None for a policy that acts as the network says.
        settings: of the distribution.
    """

    def __init__(self, distribution: type[Any] | None, settings: dict[str, Any]) -> None:
        self.distribution, self.settings = distribution, settings

    def split(self, modules: list[nn.Module]) -> tuple[str, np.ndarray | None, list[nn.Module], int]:
        """Kind of action, its bounds, the layers before it, and how many numbers each column of the action takes."""
        last = modules[-1]
        if self.distribution in DISCRETE:
            return DISCRETE[self.distribution], None, modules, 1
        if self.distribution is TanhNormal and isinstance(last, LocationScale | NormalParamExtractor):
            if self.settings.get("tanh_loc", False):
                raise _refused("TanhNormal with tanh_loc")
            low, high = (
                torch.as_tensor(self.settings.get(name, unit)) for name, unit in (("low", -1.0), ("high", 1.0))
            )
            return "bounded", _bounds(low, high, modules[:-1], 2), modules[:-1], 2
        if self.distribution is not None:
            raise _refused(f"{self.distribution.__name__} after {_name(last)}")
        if isinstance(last, Scaled) and isinstance(modules[-2], nn.Tanh):
            low, high = last.centre - last.halfwidth, last.centre + last.halfwidth
            return "bounded", _bounds(low, high, modules[:-2], 1), modules[:-2], 1
        return "plain", None, modules, 1


def _network(actor: TensorDictModule, head: _Head) -> PolicyNetwork:
    """The arrays of an actor's module."""
    module = actor.module
    if isinstance(module, RecurrentNetwork):
        weights = {name: _array(weight) for name, weight in module.lstm.named_parameters()}
        bias = weights["bias_ih_l0"] + weights["bias_hh_l0"]
        memory = Memory(weights["weight_ih_l0"], weights["weight_hh_l0"], bias)
        encoder = tuple(_layers(list(_leaves(module.encoder))))
        return _finished(module.inputs, module.policy, head, encoder, memory)
    if isinstance(module, Network):
        return _finished(module.inputs, module.body, head)
    leaves = list(_leaves(module))
    if len(actor.in_keys) == 1 and leaves and isinstance(leaves[0], nn.Linear):
        return _finished(Inputs({actor.in_keys[0]: leaves[0].in_features}), module, head)
    raise _refused(_name(module))


def _finished(
    inputs: Inputs, body: nn.Module, head: _Head, encoder: tuple[Layer, ...] = (), memory: Memory | None = None
) -> PolicyNetwork:
    kind, bounds, modules, columns = head.split(list(_leaves(body)))
    layers = list(_layers(modules))
    if columns == 2:  # locations, then scales, which the deterministic action does without
        last = layers[-1]
        half = len(last.bias) // 2
        layers[-1] = Layer(last.weight[:half], last.bias[:half], last.activation)
    normalisation, seen = None, inputs.normalisation
    if seen is not None:
        normalisation = Normalisation(_array(seen.mean), _array((seen.variance + seen.eps).rsqrt()), seen.clip)
    widths = {_text(key): width for key, width in inputs.widths.items()}
    return PolicyNetwork(widths, tuple(layers), kind, bounds, normalisation, encoder, memory)


def _parts(policy: nn.Module) -> Iterator[nn.Module]:
    """The modules of a policy in their order."""
    if isinstance(policy, TensorDictSequential):
        for part in policy.module:
            yield from _parts(part)
    else:
        yield policy


def _leaves(body: nn.Module) -> Iterator[nn.Module]:
    """The modules of a sequence in their order."""
    if isinstance(body, nn.Sequential):
        for module in body:
            yield from _leaves(module)
    elif not isinstance(body, nn.Identity):
        yield body


def _layers(modules: Sequence[nn.Module]) -> Iterator[Layer]:
    """Linear layers, each with the activation that follows it."""
    rest = list(modules)
    while rest:
        linear = rest.pop(0)
        if not isinstance(linear, nn.Linear):
            raise _refused(_name(linear))
        follows = rest.pop(0) if rest and type(rest[0]) in ACTIVATIONS else nn.Identity()
        if getattr(follows, "alpha", 1.0) != 1.0 or getattr(follows, "negative_slope", 0.01) != 0.01:
            raise _refused(str(follows))
        bias = linear.weight.new_zeros(linear.out_features) if linear.bias is None else linear.bias
        yield Layer(_array(linear.weight), _array(bias), ACTIVATIONS.get(type(follows), ""))


def _bounds(low: Tensor, high: Tensor, modules: Sequence[nn.Module], columns: int) -> np.ndarray:
    """Low and high of each column of the action."""
    last = modules[-1] if modules else None
    if not isinstance(last, nn.Linear):
        raise _refused(_name(last))
    width = last.out_features // columns
    return np.stack([np.broadcast_to(_array(bound), (width,)) for bound in (low, high)])


def _array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().to("cpu", torch.float32).numpy().copy()


def _text(key: NestedKey) -> str:
    return key if isinstance(key, str) else ".".join(key)


def _name(module: object) -> str:
    inner = getattr(module, "module", None)
    return type(inner if isinstance(inner, nn.Module) and not isinstance(inner, nn.ModuleList) else module).__name__


def _refused(what: str) -> BadInput:
    return BadInput(
        f"a policy with {what} cannot be exported",
        "what can: linear layers with " + ", ".join(ACTIVATIONS.values()) + ", an LSTM of ours, TanhNormal, categories",
    )
