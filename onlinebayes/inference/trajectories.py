"""Which keys of a TensorDict hold a trajectory: the collector's own, unless told otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from tensordict import TensorDictBase
from tensordict.utils import NestedKey
from torch import Tensor

ELSEWHERE: tuple[NestedKey, ...] = (("collector", "mask"), "masks")
"""Where TorchRL's collectors and ``tensordict.pad_sequence`` put the mask."""


@dataclass(frozen=True)
class TrajectoryKeys:
    """Keys of trajectories with batch size (B, T).

    Attributes:
        observation: (B, T, O).
        action: (B, T, A), float or one-hot.
        following: the next observation (B, T, O).
        mask: (B, T) bool, False in the padding at the end. Where the key is absent, what TorchRL's collectors
            (``split_trajs=True``) and ``tensordict.pad_sequence`` write instead; without that, all True.
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
        mask = self._mask(trajectories, values[0].shape[:2]).to(like.device)
        for index, value in enumerate(values):
            wrong = mask & ~torch.isfinite(value).all(-1)
            if bool(wrong.any()):
                row, step = wrong.nonzero()[0].tolist()
                key = (self.observation, self.action, self.following)[index]
                raise ValueError(f"{key!r} is not finite in trajectory {row}, step {step}; set its mask to False there")
            values[index] = torch.where(mask.unsqueeze(-1), value, torch.zeros_like(value))
        return values[0], values[1], values[2], mask

    def _mask(self, trajectories: TensorDictBase, shape: torch.Size) -> Tensor:
        for key in (self.mask, *ELSEWHERE):
            found = trajectories.get(key, None)
            if found is None:
                continue
            # pad_sequence gives every entry a mask of its own.
            leaves = list(found.values(True, True)) if isinstance(found, TensorDictBase) else [found]
            if any(leaf.dtype != torch.bool or leaf.squeeze(-1).shape != shape for leaf in leaves):
                told = ", ".join(f"{leaf.dtype} {tuple(leaf.shape)}" for leaf in leaves)
                raise ValueError(f"the mask under {key!r} is {told}; trajectories of shape {tuple(shape)} need bool")
            return torch.stack([leaf.reshape(shape) for leaf in leaves]).all(0)
        return torch.ones(shape, dtype=torch.bool)

    def read_theta(self, trajectories: TensorDictBase) -> Tensor:
        """Theta (B, P) in its own dtype."""
        theta = trajectories.get(self.theta)
        return theta[:, 0] if theta.ndim == 3 else theta
