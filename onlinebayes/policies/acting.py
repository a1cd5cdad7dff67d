"""A policy that acts in numpy alone: the deterministic action of a trained network, some ten microseconds a step.

The equations stand in ``network``. Numbers are in single precision, as in training.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import isfinite
from typing import Any, final

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from onlinebayes.policies.card import PolicyCard
from onlinebayes.policies.network import Layer, PolicyNetwork
from onlinebayes.runs import BadInput, nearest

Observation = ArrayLike | Mapping[str, Any]
Function = Callable[[np.ndarray], np.ndarray]


def _sigmoid(x: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(0.5 * x)


FUNCTIONS: dict[str, Function | None] = {
    "": None,
    "elu": lambda x: np.where(x > 0, x, np.expm1(np.minimum(x, 0))),
    "leaky_relu": lambda x: np.where(x > 0, x, np.float32(0.01) * x),
    "relu": lambda x: np.maximum(x, np.float32(0)),
    "sigmoid": _sigmoid,
    "silu": lambda x: x * _sigmoid(x),
    "tanh": np.tanh,
}


@final
class NumpyPolicy:
    """A trained policy: ``act(observation)`` gives its deterministic action.

    Args:
        network: its arrays.
        card: what it is for.

    Attributes:
        card: names, units and bounds of what it sees and does, and where it comes from.
        memory: of a recurrent policy, hidden and cell state (2, H); zero after :meth:`reset`. None without one.
    """

    def __init__(self, network: PolicyNetwork, card: PolicyCard) -> None:
        self.network, self.card = network, card
        self._width, self._names = network.width, {channel.name: k for k, channel in enumerate(card.observation)}
        self._encoder = [_prepared(layer) for layer in network.encoder]
        self._layers = [_prepared(layer) for layer in network.layers]
        self._finish = _finished(network)
        self.memory: Float[np.ndarray, "2 H"] | None = None
        if network.memory is not None:
            cell = network.memory
            weight = np.concatenate([cell.seen, cell.kept], axis=1)
            self._gates = _prepared(Layer(weight, cell.bias))[:2]
        self.reset()

    def reset(self) -> None:
        """An episode begins: a recurrent policy forgets the one before. Others have nothing to forget."""
        if self.network.memory is not None:
            self.memory = np.zeros((2, self.network.memory.width), dtype=np.float32)

    def act(self, observation: Observation) -> np.ndarray:
        """The action for an observation.

        Args:
            observation: numbers (F,) in the card's order; or a mapping, of the card's keys to arrays or of the names of
                its columns to numbers. A policy without memory takes rows (N, F) too.

        Returns:
            (A,) within the bounds and in the card's order; one-hot (A,) or an index () for a discrete action.

        Raises:
            BadInput: another width, a name that is missing, or a number that is NaN or infinite.
        """
        row = self._row(observation) if isinstance(observation, Mapping) else np.asarray(observation, np.float32)
        if row.shape[-1:] != (self._width,) or (self.memory is not None and row.ndim != 1):
            raise BadInput(
                f"an observation of shape {row.shape}, the policy sees ({self._width},)",
                f"give, in this order: {self.card.seen()}",
            )
        if not isfinite(row.sum()):
            self._refuse_nonfinite(row)
        normalisation = self.network.normalisation
        if normalisation is not None:
            row = (row - normalisation.mean) * normalisation.scale
            row = np.minimum(np.maximum(row, -normalisation.clip), normalisation.clip)
        if self.memory is not None:
            row = self._remembered(_through(self._encoder, row))
        return self._finish(_through(self._layers, row))

    def _remembered(self, seen: Float[np.ndarray, " F"]) -> Float[np.ndarray, " H"]:
        """One step of the LSTM."""
        assert self.memory is not None
        hidden, cell = self.memory
        weight, bias = self._gates
        gates = np.concatenate([seen, hidden]) @ weight + bias
        inward, forget, candidate, outward = gates.reshape(4, -1)
        cell = _sigmoid(forget) * cell + _sigmoid(inward) * np.tanh(candidate)
        hidden = _sigmoid(outward) * np.tanh(cell)
        self.memory = np.stack([hidden, cell])
        return hidden

    def _row(self, observation: Mapping[str, Any]) -> np.ndarray:
        """The values of a mapping in the card's order."""
        by_key = all(key in observation for key in self.network.inputs)
        wanted = list(self.network.inputs) if by_key else list(self._names)
        missing = [name for name in wanted if name not in observation]
        if missing:
            raise BadInput(
                f"the observation has no {missing[0]!r}; {nearest(missing[0], map(str, observation))}",
                f"give arrays {', '.join(self.network.inputs)}, or a number for each of: {self.card.seen()}",
            )
        if not by_key:
            return np.array([observation[name] for name in wanted], dtype=np.float32)
        return np.concatenate([np.asarray(observation[key], np.float32) for key in wanted], axis=-1)

    def _refuse_nonfinite(self, row: np.ndarray) -> None:
        """Refuse a row with a NaN or an infinity; a sum of large numbers may overflow without one."""
        bad = ~np.isfinite(row.reshape(-1, self._width)).all(axis=0)
        if bad.any():
            names = [channel.name for channel in self.card.observation]
            told = [f"{names[k]!r}" for k in np.flatnonzero(bad)]
            raise BadInput(f"the observation is NaN or infinite in {', '.join(told)}", "look at that sensor")


def _prepared(layer: Layer) -> tuple[np.ndarray, np.ndarray, Function | None]:
    """Its weight as x @ weight wants it."""
    weight = np.ascontiguousarray(layer.weight.T, dtype=np.float32)
    return weight, layer.bias.astype(np.float32), FUNCTIONS[layer.activation]


def _through(layers: list[tuple[np.ndarray, np.ndarray, Function | None]], x: np.ndarray) -> np.ndarray:
    for weight, bias, function in layers:
        x = x @ weight
        x += bias
        if function is not None:
            x = function(x)
    return x


def _finished(network: PolicyNetwork) -> Function:
    """The step from the last layer's outputs to the action."""
    if network.action == "plain":
        return lambda u: u
    if network.action == "index":
        return lambda u: np.asarray(u.argmax(-1))
    if network.action == "one-hot":
        each = np.eye(network.outputs, dtype=np.int64)
        return lambda u: each[u.argmax(-1)]
    assert network.bounds is not None
    low, high = network.bounds.astype(np.float32)
    centre, halfwidth = (high + low) / 2, (high - low) / 2
    return lambda u: centre + halfwidth * np.tanh(u)
