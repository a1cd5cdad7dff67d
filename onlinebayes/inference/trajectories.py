"""Which keys of a TensorDict hold a trajectory: the collector's own, unless told otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey
from torch import Tensor


@dataclass(frozen=True)
class TrajectoryKeys:
    """Keys of trajectories with batch size (B, T).

    Attributes:
        observation: (B, T, O).
        action: (B, T, A), float or one-hot.
        following: the next observation (B, T, O).
        mask: (B, T) bool, False in the padding at the end; all True where the key is absent.
        theta: (B, P), or (B, T, P) constant in time.
    """

    observation: NestedKey = "observation"
    action: NestedKey = "action"
    following: NestedKey = ("next", "observation")
    mask: NestedKey = "mask"
    theta: NestedKey = "theta"

    def read(self, trajectories: TensorDictBase, like: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Observation, action, next observation in the dtype and on the device of ``like``, and the mask.

        Raises:
            ValueError: a key is missing, or a recorded step holds nan or inf.
        """
        values = []
        for key in (self.observation, self.action, self.following):
            value = trajectories.get(key, None)
            if value is None:
                raise ValueError(
                    f"the trajectories have no key {key!r}; they have {sorted(map(str, trajectories.keys(True)))}"
                )
            values.append(value.to(like))
        mask = trajectories.get(self.mask, None)
        if mask is None:
            mask = torch.ones(values[0].shape[:2], dtype=torch.bool, device=like.device)
        mask = mask.to(like.device)
        for index, value in enumerate(values):
            wrong = mask & ~torch.isfinite(value).all(-1)
            if bool(wrong.any()):
                row, step = wrong.nonzero()[0].tolist()
                key = (self.observation, self.action, self.following)[index]
                raise ValueError(f"{key!r} is not finite in trajectory {row}, step {step}; set its mask to False there")
            values[index] = torch.where(mask.unsqueeze(-1), value, torch.zeros_like(value))
        return values[0], values[1], values[2], mask

    def read_theta(self, trajectories: TensorDictBase) -> Tensor:
        """Theta (B, P) in its own dtype."""
        theta = trajectories.get(self.theta)
        return theta[:, 0] if theta.ndim == 3 else theta
