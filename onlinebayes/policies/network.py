"""A policy's network as plain arrays: what a layer, a memory and an action are, and their names in a file.

row    = clip((x - mean) scale, -c, c)                          where what is seen is normalised
h, c   = LSTM(encoder(row), h, c)                               where there is a memory
u      = layers(row or h),     layer: f(W x + b)
action = centre + halfwidth tanh(u)        "bounded"
         1 where u is largest, else 0      "one-hot"
         the place where u is largest      "index"
         u                                 "plain"
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float

ACTIVATIONS = ("", "elu", "leaky_relu", "relu", "sigmoid", "silu", "tanh")
"""Names of the activations between layers; empty for a linear one."""
ACTIONS = ("bounded", "one-hot", "index", "plain")


@dataclass(frozen=True, eq=False)
class Layer:
    """f(W x + b).

    Args:
        weight: W.
        bias: b.
        activation: f, one of :data:`ACTIVATIONS`.
    """

    weight: Float[np.ndarray, "out in"]
    bias: Float[np.ndarray, " out"]
    activation: str = ""


@dataclass(frozen=True, eq=False)
class Normalisation:
    """clip((x - mean) scale, -c, c).

    Args:
        mean: of what was seen.
        scale: one over its standard deviation.
        clip: c.
    """

    mean: Float[np.ndarray, " F"]
    scale: Float[np.ndarray, " F"]
    clip: float


@dataclass(frozen=True, eq=False)
class Memory:
    """An LSTM of H units: gates i, f, g, o = W_x x + W_h h + b, in this order.

    Args:
        seen: W_x.
        kept: W_h.
        bias: b.
    """

    seen: Float[np.ndarray, "H4 F"]
    kept: Float[np.ndarray, "H4 H"]
    bias: Float[np.ndarray, " H4"]

    @property
    def width(self) -> int:
        """H."""
        return self.kept.shape[1]


@dataclass(frozen=True, eq=False)
class PolicyNetwork:
    """From an observation to an action.

    Args:
        inputs: key of what is seen -> width, in order; together F.
        layers: before the action.
        action: kind of the action, one of :data:`ACTIONS`.
        bounds: low and high of a bounded action (2, A).
        normalisation: of what is seen.
        encoder: before the memory, where there is one.
        memory: between encoder and layers.
    """

    inputs: Mapping[str, int]
    layers: tuple[Layer, ...]
    action: str
    bounds: Float[np.ndarray, "2 A"] | None = None
    normalisation: Normalisation | None = None
    encoder: tuple[Layer, ...] = field(default=())
    memory: Memory | None = None

    @property
    def width(self) -> int:
        """F."""
        return sum(self.inputs.values())

    @property
    def outputs(self) -> int:
        """Number of the action's columns, or of the choices of a discrete one."""
        return len(self.layers[-1].bias)


def to_arrays(network: PolicyNetwork) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Its arrays by name, and the rest as plain values."""
    arrays: dict[str, np.ndarray] = {}
    for part, layers in (("encoder", network.encoder), ("layers", network.layers)):
        for k, layer in enumerate(layers):
            arrays |= {f"{part}.{k}.weight": layer.weight, f"{part}.{k}.bias": layer.bias}
    about: dict[str, Any] = {
        "inputs": dict(network.inputs),
        "encoder": [layer.activation for layer in network.encoder],
        "layers": [layer.activation for layer in network.layers],
        "action": network.action,
    }
    if network.bounds is not None:
        arrays["action.bounds"] = network.bounds
    if network.normalisation is not None:
        arrays |= {"normalisation.mean": network.normalisation.mean, "normalisation.scale": network.normalisation.scale}
        about["clip"] = network.normalisation.clip
    if network.memory is not None:
        memory = network.memory
        arrays |= {"memory.seen": memory.seen, "memory.kept": memory.kept, "memory.bias": memory.bias}
    return arrays, about


def from_arrays(arrays: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> PolicyNetwork:
    """The inverse of :func:`to_arrays`.

    Raises:
        KeyError, ValueError: they are not of a policy, or do not fit together.
    """
    memory = [arrays[f"memory.{name}"] for name in ("seen", "kept", "bias")] if "memory.kept" in arrays else None
    normalised = [arrays[f"normalisation.{name}"] for name in ("mean", "scale")] if "clip" in about else None
    network = PolicyNetwork(
        inputs=dict(about["inputs"]),
        layers=tuple(_layers("layers", arrays, about)),
        action=about["action"],
        bounds=arrays["action.bounds"] if about["action"] == "bounded" else None,
        normalisation=None if normalised is None else Normalisation(normalised[0], normalised[1], about["clip"]),
        encoder=tuple(_layers("encoder", arrays, about)),
        memory=None if memory is None else Memory(memory[0], memory[1], memory[2]),
    )
    if network.action not in ACTIONS or not network.layers:
        raise ValueError(f"an action of kind {network.action!r} after {len(network.layers)} layers")
    return network


def _layers(part: str, arrays: Mapping[str, np.ndarray], about: Mapping[str, Any]) -> Iterator[Layer]:
    for k, activation in enumerate(about[part]):
        if activation not in ACTIVATIONS:
            raise ValueError(f"an activation {activation!r}")
        yield Layer(arrays[f"{part}.{k}.weight"], arrays[f"{part}.{k}.bias"], activation)
