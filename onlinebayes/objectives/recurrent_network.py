"""A network with a memory, with the heads of a policy and of a value.

    h_t, c_t = LSTM(f(s_t), h_{t-1}, c_{t-1}),  zero where an episode begins
    pi(a | h_t),  V(h_t)

Hochreiter and Schmidhuber, Long Short-Term Memory (1997).
"""

from __future__ import annotations

import itertools
from typing import final

import torch
from jaxtyping import Bool, Float
from tensordict import NestedKey
from torch import Tensor, nn
from torchrl.data import Composite, Unbounded
from torchrl.envs import TensorDictPrimer

from onlinebayes.objectives.inputs import Inputs


@final
class RecurrentNetwork(nn.Module):
    """Inputs and memory -> what the policy's head says, the value, the next memory.

    Args:
        inputs: what is seen.
        width: H, units of the memory and of the layer before it.
        policy: (*batch, H) -> a distribution's parameters.
        activation: of the layer before the memory.
        memory_key: of the memory.
        device: of the weights.
    """

    def __init__(
        self,
        inputs: Inputs,
        width: int,
        policy: nn.Module,
        activation: type[nn.Module],
        memory_key: NestedKey,
        device: torch.device | str | None = None,
    ) -> None:
        super().__init__()
        self.inputs, self.width, self.policy, self.memory_key = inputs, width, policy, memory_key
        self.encoder = nn.Sequential(nn.Linear(inputs.width, width, device=device), activation())
        self.lstm = nn.LSTM(width, width, batch_first=True, device=device)
        self.value = nn.Linear(width, 1, device=device)

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        """One step: observed values (*batch, _), then ``is_init`` (*batch, 1) and the memory (*batch, 2, H)."""
        *observed, begins, memory = values
        batch = memory.shape[:-2]
        row = self.inputs(*observed).reshape(-1, 1, self.inputs.width)
        memory = (memory * ~begins.unsqueeze(-1)).reshape(-1, 2, self.width)
        out, memory = self._run(self.encoder(row), memory)
        out = out.reshape(*batch, self.width)
        parameters = self.policy(out)
        parameters = parameters if isinstance(parameters, tuple) else (parameters,)
        return *parameters, self.value(out), memory.reshape(*batch, 2, self.width)

    def unroll(
        self,
        row: Float[Tensor, "N T F"],
        following: Float[Tensor, "N T F"],
        begins: Bool[Tensor, "N T"],
        memory: Float[Tensor, "N 2 H"],
    ) -> tuple[Float[Tensor, "N T H"], Float[Tensor, "N T H"]]:
        """Return the inputs of the heads at each step of a batch, and at the state that follows each step.

        Args:
            row: what is seen.
            following: what is seen after the step, before a reset.
            begins: where an episode begins.
            memory: before the first step.
        """
        steps = row.shape[1]
        seen, outs, thens = self.encoder(row), [], []
        # Between two columns in which some world begins anew, the LSTM runs through without a look.
        edges = [0, *(begins[:, 1:].any(0).nonzero().flatten() + 1).tolist(), steps]
        for first, last in itertools.pairwise(edges):
            memory = memory * ~begins[:, first, None, None]
            out, memory = self._run(seen[:, first:last], memory)
            then, _ = self._run(self.encoder(following[:, last - 1 : last]), memory)
            outs.append(out)
            thens += [out[:, 1:], then]
        return torch.cat(outs, 1), torch.cat(thens, 1)

    def make_tensordict_primer(self) -> TensorDictPrimer:
        """The transform that gives worlds an empty memory at their reset."""
        empty = Unbounded((2, self.width), device=self.value.weight.device)
        primers = Composite()
        primers[self.memory_key] = empty
        return TensorDictPrimer(primers, default_value=0.0, expand_specs=True)

    def _run(self, seen: Float[Tensor, "B T H"], memory: Float[Tensor, "B 2 H"]) -> tuple[Tensor, Tensor]:
        hidden, cell = (part.unsqueeze(0).contiguous() for part in memory.unbind(1))
        out, (hidden, cell) = self.lstm(seen, (hidden, cell))
        return out, torch.stack([hidden[0], cell[0]], 1)
