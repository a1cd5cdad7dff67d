"""Several perceptrons of one shape, evaluated at once: x (B, F) -> (K, B, outputs).

h_k = act(h_k W_k + b_k)      one batched product a layer for all K networks
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn


class EnsembleMLP(nn.Module):
    """K multilayer perceptrons, each with weights of its own, initialised as ``nn.Linear`` is.

    Args:
        members: number K.
        inputs: width F of a row.
        outputs: of each network.
        widths: units of the hidden layers.
        activation: between the layers.
        device: of the weights.
    """

    def __init__(
        self,
        members: int,
        inputs: int,
        outputs: int,
        widths: Sequence[int],
        activation: type[nn.Module],
        device: torch.device | str | None = None,
    ) -> None:
        super().__init__()
        sizes = [inputs, *widths, outputs]
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for fan_in, fan_out in itertools.pairwise(sizes):
            bound = 1 / math.sqrt(fan_in)
            for into, rows in ((self.weights, fan_in), (self.biases, 1)):
                start = torch.empty(members, rows, fan_out, device=device).uniform_(-bound, bound)
                into.append(nn.Parameter(start))
        self.activation = activation()

    def forward(self, rows: Float[Tensor, "B F"], *, frozen: bool = False) -> Float[Tensor, "K B O"]:
        """Each network's answer to each row.

        Args:
            rows: seen by every network.
            frozen: whether gradients stop at the weights (they pass to the rows).
        """
        layers = list(zip(self.weights, self.biases, strict=True))
        x = rows.expand(layers[0][0].shape[0], *rows.shape)
        for i, (weight, bias) in enumerate(layers):
            if frozen:
                weight, bias = weight.detach(), bias.detach()
            x = torch.baddbmm(bias, x, weight)
            if i + 1 < len(layers):
                x = self.activation(x)
        return x
