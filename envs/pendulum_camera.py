"""A camera that looks at a pendulum's axle under changing light: the last frames of 64 x 64 pixels, grey, 0 to 255.

    g(x, y) = b + s . (x, y) + m(x, y) (c (1 + 0.4 cos(phi - l)) - s . (x, y)) + 0.02 e,      -1 <= x, y <= 1

m is 1 on a hand of length 0.8 at angle phi from upright and 0 beside it, with soft edges; e ~ N(0, 1). The light is
drawn anew for each episode: brightness b, its slope s over the picture, the hand's contrast c and the direction l from
which it shines. The hand has one length in all worlds: what a frame shows is the angle, and nothing of the pendulum.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, UInt8
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import Transform

SIZE = 64
HAND, WIDTH, SOFT = 0.8, 0.07, 0.03
NOISE, SHINE = 0.02, 0.4
LOW, HIGH = (0.1, -0.25, -0.25, 0.2, -math.pi), (0.5, 0.25, 0.25, 0.5, math.pi)
"""Ends of the light's ranges: b, s (two), c [1], l [rad]."""


def frames(
    angle: Float[Tensor, "*B"], light: Float[Tensor, "*B 5"], noise: Float[Tensor, "*B y x"]
) -> UInt8[Tensor, "*B 1 y x"]:
    """The pictures of hands at some angles from upright [rad]; ``noise`` of sd 1 for each pixel."""
    line = torch.linspace(-1, 1, SIZE, dtype=light.dtype, device=light.device)
    y, x = torch.meshgrid(-line, line, indexing="ij")
    b, across, up, c, shines = (one[..., None, None] for one in light.unbind(-1))
    phi = angle.to(light.dtype)[..., None, None]
    along = (x * phi.sin() + y * phi.cos()).clamp(0, HAND)
    away = ((x - along * phi.sin()).square() + (y - along * phi.cos()).square()).sqrt()
    hand, slope = torch.sigmoid((WIDTH - away) / SOFT), across * x + up * y
    grey = b + slope + hand * (c * (1 + SHINE * torch.cos(phi - shines)) - slope) + NOISE * noise
    return (255 * grey.clamp(0, 1)).round().to(torch.uint8)[..., None, :, :]


class PendulumCamera(Transform):
    """Add ``pixels``, the last frames of an episode, and the ``light`` in which they were taken.

    Both stand in the TensorDict from step to step: the transform remembers nothing but its random numbers.

    Args:
        last: how many frames, the newest at the end; an episode begins with copies of its first.
        seed: of lights and noise.
    """

    def __init__(self, last: int = 3, *, seed: int = 0) -> None:
        super().__init__(in_keys=["observation"], out_keys=["pixels", "light"])
        self.last = last
        self._generator = torch.Generator().manual_seed(seed)

    def get_extra_state(self) -> Tensor:
        """State of the random numbers."""
        return self._generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Draw on from there."""
        self._generator.set_state(state.cpu())

    def transform_observation_spec(self, observation_spec: Composite) -> Composite:
        """With the two keys."""
        batch, device = observation_spec.shape, observation_spec.device
        shape = (*batch, self.last, SIZE, SIZE)
        observation_spec["pixels"] = Bounded(0, 255, shape=shape, dtype=torch.uint8, device=device)
        observation_spec["light"] = Unbounded((*batch, len(LOW)), device=device)
        return observation_spec

    def _frame(self, observation: Float[Tensor, "*B O"], light: Float[Tensor, "*B 5"]) -> UInt8[Tensor, "*B 1 y x"]:
        cos, sin = observation[..., :2].unbind(-1)
        noise = torch.randn((*cos.shape, SIZE, SIZE), generator=self._generator).to(light)
        return frames(torch.atan2(sin, cos), light, noise)

    def _step(self, tensordict: TensorDictBase, next_tensordict: TensorDictBase) -> TensorDictBase:
        light = tensordict.get("light")
        newest = self._frame(next_tensordict.get("observation"), light)
        pixels = torch.cat([tensordict.get("pixels")[..., 1:, :, :], newest], dim=-3)
        return next_tensordict.set("pixels", pixels).set("light", light)

    def _reset(self, tensordict: TensorDictBase, tensordict_reset: TensorDictBase) -> TensorDictBase:
        observation = tensordict_reset.get("observation")
        low, high = observation.new_tensor(LOW), observation.new_tensor(HIGH)
        drawn = torch.rand((*observation.shape[:-1], len(LOW)), generator=self._generator)
        light = low + (high - low) * drawn.to(observation)
        pixels = self._frame(observation, light).repeat_interleave(self.last, dim=-3)
        anew = tensordict.get("_reset", None)
        if anew is not None and tensordict.get("light", None) is not None:
            # Worlds that go on keep their light and their frames.
            anew = anew.reshape(*light.shape[:-1], 1)
            light = torch.where(anew, light, tensordict.get("light"))
            pixels = torch.where(anew[..., None, None], pixels, tensordict.get("pixels"))
        return tensordict_reset.set("pixels", pixels).set("light", light)
