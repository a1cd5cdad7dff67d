"""Every episode in a world of its own: theta is drawn where worlds reset and stays until they reset again.

    theta_i ~ p   for exactly the worlds i that reset,    theta_i constant within an episode

TorchRL hides everything but the reset mask from an environment that resets itself (issue #1465 of pytorch/rl), so the
draw happens before the environment's own reset and reaches it on the leaf ``"theta"``.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import Transform


@runtime_checkable
class Distribution(Protocol):
    """Anything to draw parameters from: priors, posteriors, proposals."""

    def sample(self, shape: tuple[int, ...], /) -> Tensor:
        """Draws of shape (*shape, P) [SI]."""
        ...


class ParameterRandomization(Transform):
    """Draw theta for the worlds that reset.

    The environment below must read ``"theta"`` in its reset and carry it in every step, as ``SimulatorEnv`` does.
    As a module (:meth:`forward`) it writes a fresh draw for every element of a tensordict.

    Args:
        distribution: where theta comes from; replaceable with :meth:`set_distribution`, which takes effect world by
            world as they reset.
    """

    def __init__(self, distribution: Distribution) -> None:
        super().__init__()
        self._distribution = distribution

    @property
    def distribution(self) -> Distribution:
        """Where theta comes from now."""
        return self._distribution

    def set_distribution(self, distribution: Distribution) -> None:
        """Draw from another distribution from the next reset on."""
        self._distribution = distribution

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write a fresh draw for every element."""
        return tensordict.set("theta", self._draw(tensordict.numel()).reshape(*tensordict.batch_size, -1))

    def _draw(self, number: int) -> Tensor:
        with torch.no_grad():
            return self._distribution.sample((number,))

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        return next_tensordict

    def _reset_env_preprocess(self, tensordict: TensorDictBase | None) -> TensorDictBase:
        if tensordict is None:
            parent = self.parent
            tensordict = TensorDict(batch_size=parent.batch_size, device=parent.device)
        batch = tensordict.batch_size
        reset = tensordict.get("_reset", None)
        if reset is None:
            return tensordict.set("theta", self._draw(batch.numel()).reshape(*batch, -1))
        rows = reset.reshape(-1).nonzero().squeeze(-1)
        drawn = self._draw(len(rows)).to(reset.device)
        theta = drawn.new_zeros(batch.numel(), drawn.shape[-1]).index_copy_(0, rows, drawn)
        return tensordict.set("theta", theta.reshape(*batch, -1))
