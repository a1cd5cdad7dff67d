"""A policy as an ONNX file, by ``torch.onnx``, for runtimes that read no Python; needs the extra ``onnx``.

inputs    observation (1, F), and memory (1, 2, H) of a recurrent policy
outputs   action (1, A), one-hot (1, A) or index (1,), and the next memory
"""

from __future__ import annotations

import warnings
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from onlinebayes.policies.files import read_policy
from onlinebayes.policies.network import Layer, PolicyNetwork
from onlinebayes.runs import BadInput, atomic_path

MODULES: dict[str, type[nn.Module]] = {
    "": nn.Identity,
    "elu": nn.ELU,
    "leaky_relu": nn.LeakyReLU,
    "relu": nn.ReLU,
    "sigmoid": nn.Sigmoid,
    "silu": nn.SiLU,
    "tanh": nn.Tanh,
}


def write_onnx(folder: str | Path, path: str | Path) -> None:
    """Write the policy of a run as ONNX, whole or not at all.

    Args:
        folder: as :func:`~onlinebayes.policies.load_policy` takes it.
        path: of the file.

    Raises:
        BadInput: there is no policy, its file is damaged, or the extra is not installed.
    """
    network, _ = read_policy(folder)
    missing = [name for name in ("onnx", "onnxscript") if find_spec(name) is None]
    if missing:
        raise BadInput(f"the package {missing[0]} is not installed", "pip install 'onlinebayes[onnx]'")
    example: tuple[Tensor, ...] = (torch.zeros(1, network.width),)
    names, outputs = ["observation"], ["action"]
    if network.memory is not None:
        example += (torch.zeros(1, 2, network.memory.width),)
        names, outputs = ["observation", "memory"], ["action", "next_memory"]
    with atomic_path(path) as temporary, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of torch and onnxscript, about themselves
        program = torch.onnx.export(
            TorchPolicy(network).eval(), example, input_names=names, output_names=outputs, dynamo=True, verbose=False
        )
        assert program is not None
        program.save(temporary)


class TorchPolicy(nn.Module):
    """The equations of ``network`` in torch.

    Args:
        network: the policy's arrays.
    """

    mean: Tensor
    scale: Tensor
    low: Tensor
    high: Tensor

    def __init__(self, network: PolicyNetwork) -> None:
        super().__init__()
        self.network = network
        self.encoder, self.layers = (nn.Sequential(*map(_module, part)) for part in (network.encoder, network.layers))
        if network.normalisation is not None:
            self.register_buffer("mean", _tensor(network.normalisation.mean))
            self.register_buffer("scale", _tensor(network.normalisation.scale))
        if network.bounds is not None:
            low, high = network.bounds
            self.register_buffer("low", _tensor(low))
            self.register_buffer("high", _tensor(high))
        if network.memory is not None:
            cell = network.memory
            self.gates = _linear(Layer(np.concatenate([cell.seen, cell.kept], axis=1), cell.bias))

    def forward(self, observation: Tensor, memory: Tensor | None = None) -> Tensor | tuple[Tensor, Tensor]:
        """The action, and the next memory of a recurrent policy."""
        row, normalisation = observation, self.network.normalisation
        if normalisation is not None:
            row = ((row - self.mean) * self.scale).clamp(-normalisation.clip, normalisation.clip)
        if memory is None:
            return self._action(self.layers(row))
        hidden, cell = memory.unbind(1)
        inward, forget, candidate, outward = self.gates(torch.cat([self.encoder(row), hidden], -1)).chunk(4, -1)
        cell = torch.sigmoid(forget) * cell + torch.sigmoid(inward) * torch.tanh(candidate)
        hidden = torch.sigmoid(outward) * torch.tanh(cell)
        return self._action(self.layers(hidden)), torch.stack([hidden, cell], 1)

    def _action(self, u: Tensor) -> Tensor:
        if self.network.action == "bounded":
            return (self.high + self.low) / 2 + (self.high - self.low) / 2 * torch.tanh(u)
        if self.network.action == "plain":
            return u
        place = u.argmax(-1)
        return place if self.network.action == "index" else nn.functional.one_hot(place, self.network.outputs)


def _tensor(array: np.ndarray) -> Tensor:
    return torch.tensor(array, dtype=torch.float32)


def _linear(layer: Layer) -> nn.Linear:
    linear = nn.Linear(layer.weight.shape[1], layer.weight.shape[0])
    with torch.no_grad():
        linear.weight.copy_(_tensor(layer.weight))
        linear.bias.copy_(_tensor(layer.bias))
    return linear


def _module(layer: Layer) -> nn.Module:
    return nn.Sequential(_linear(layer), MODULES[layer.activation]())
