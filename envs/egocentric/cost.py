"""Cost of a second of camera: a price of charge, and how fast the camera takes it from the battery.

    cost = price [1/mAh] x i_camera [mA] x 1 s / 3600 s/h

A policy that sees the cost is conditioned on the phone's discharge rate: where the battery empties faster, a second of
camera costs more. In simulation theta is the world's own; on a phone, where nobody knows it, it is what is believed.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Composite, Unbounded
from torchrl.envs import Transform

from envs.egocentric.phone import HOUR


class CameraCost(Transform):
    """``"price"`` (N, 1) and ``"theta"`` (N, 2) -> ``"cost"`` (N, 1).

    Args:
        believed: theta in the place of the worlds' own (2,) [mA].
    """

    def __init__(self, believed: Float[Tensor, " 2"] | None = None) -> None:
        super().__init__(in_keys=["price", "theta"], out_keys=["cost"])
        self.believed = believed

    def _call(self, next_tensordict: TensorDictBase) -> TensorDictBase:
        price = next_tensordict.get("price")
        theta = next_tensordict.get("theta") if self.believed is None else self.believed.to(price.device)
        return next_tensordict.set("cost", (price * theta[..., 1:] / HOUR).float())

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        return self._call(tensordict_reset)

    forward = _call

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """Adds the cost."""
        observation_spec["cost"] = Unbounded((*observation_spec.shape, 1), dtype=torch.float32)
        return observation_spec
