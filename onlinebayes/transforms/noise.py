"""Sensor noise: what is observed is the state seen through sensors of finite precision.

    o~_k = o_k + sd * e_k,    e_k ~ N(0, I) independent

The same noisy value is what the policy acts on at step k and what stands in ``("next", "observation")`` of step k - 1.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.envs import Transform


class SensorNoise(Transform):
    """Add independent Gaussian noise to an observation.

    Args:
        sd: standard deviation of each observed value (O,), in that value's unit; zeros add nothing.
        seed: of the noise.
        key: of the observation.
    """

    def __init__(self, sd: Float[Tensor, " O"], *, seed: int = 0, key: NestedKey = "observation") -> None:
        super().__init__(in_keys=[key], out_keys=[key])
        self.key = key
        self.register_buffer("sd", sd)
        self._generator = torch.Generator(sd.device).manual_seed(seed)

    def get_extra_state(self) -> Tensor:
        """State of the noise's random numbers."""
        return self._generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Draw on from there."""
        self._generator.set_state(state.cpu())

    def _apply_transform(self, obs: Tensor) -> Tensor:
        # An environment moves the transform to its device, but no generator: it draws where it was made.
        noise = torch.randn(obs.shape, dtype=obs.dtype, device=self._generator.device, generator=self._generator)
        return obs + self.get_buffer("sd").to(obs) * noise.to(obs)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        fresh = self._apply_transform(tensordict_reset.get(self.key))
        reset, seen = tensordict.get("_reset", None), tensordict.get(self.key, None)
        if reset is not None and seen is not None:
            # Worlds that go on have been seen already; a second draw would contradict what the policy was told.
            fresh = torch.where(reset.reshape(*fresh.shape[:-1], 1), fresh, seen)
        return tensordict_reset.set(self.key, fresh)
