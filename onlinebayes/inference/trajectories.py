"""Keys of a TensorDict that hold a trajectory: the collector's own, unless told otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDictBase
from tensordict.utils import NestedKey
from torch import Tensor

from onlinebayes.inference.distributions import Box
from onlinebayes.runs import BadInput

ELSEWHERE: tuple[NestedKey, ...] = (("collector", "mask"), "masks")
"""Keys under which TorchRL's collectors and ``tensordict.pad_sequence`` put the mask."""

ROUNDING = 1e-3
"""Largest distance of z from its box [widths of the box]: single precision of theta in a box a thousandth wide."""

SHAPE_CURE = (
    "needs (trajectories, steps, width): add [None] to a single trajectory, [..., None] to one number a step, and give "
    "a choice as torch.nn.functional.one_hot"
)


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

    def read(
        self, trajectories: TensorDictBase, like: Tensor, *, of_sets: bool = False
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Observation, action, next observation in the dtype and on the device of ``like``, and the mask.

        Args:
            trajectories: (B, T).
            like: see above.
            of_sets: they are members of sets, which an empty one only makes smaller.

        Raises:
            BadInput: no trajectory, a missing key, another shape, a trajectory without a recorded step (an embedding
                has nothing to say of it), or nan or inf in a recorded step.
        """
        values = [value.to(like) for value in self._values(trajectories)]
        mask = self._mask(trajectories, values[0].shape[:2]).to(like.device)
        if not of_sets and bool((~mask.any(1)).any()):
            row, empty = int((~mask.any(1)).nonzero()[0]), int((~mask.any(1)).sum())
            raise BadInput(f"trajectory {row} ({empty} such) has no recorded step", "leave it out")
        for index, (key, value) in enumerate(zip(self._told, values, strict=True)):
            wrong = mask & ~torch.isfinite(value).all(-1)
            if bool(wrong.any()):
                row, step = wrong.nonzero()[0].tolist()
                self._blame_theta(trajectories, row)
                raise BadInput(
                    f"{key!r} is not finite in trajectory {row}, step {step}", "set its mask to False from there on"
                )
            values[index] = torch.where(mask.unsqueeze(-1), value, torch.zeros_like(value))
        return values[0], values[1], values[2], mask

    def recorded(self, simulations: TensorDictBase) -> Bool[Tensor, " B"]:
        """Find the trajectories that hold a recorded step; those of worlds that diverged at once hold none.

        They can be left out of any inference that conditions on a recorded trajectory: p(theta | x) of such an x is
        the same whatever becomes of the others.

        Raises:
            BadInput: none does.
        """
        found = self._mask(simulations, self._values(simulations)[0].shape[:2]).any(1)
        if not bool(found.any()):
            raise BadInput(
                f"none of {len(found)} simulations has a recorded step: every world diverged",
                "narrow the parameters' bounds, or shorten the simulator's step",
            )
        return found

    def mask_of(self, trajectories: TensorDictBase) -> Bool[Tensor, "B T"]:
        """Return the mask of the recorded steps of trajectories (B, T), wherever it stands."""
        return self._mask(trajectories, self._values(trajectories)[0].shape[:2])

    def usable(self, simulations: TensorDictBase) -> TensorDictBase:
        """The simulations with a recorded step; see :meth:`recorded`."""
        found = self.recorded(simulations)
        return simulations if bool(found.all()) else simulations[found]

    def read_theta(self, trajectories: TensorDictBase) -> Float[Tensor, "B P"]:
        """Theta (B, P) in its own dtype.

        Raises:
            BadInput: it is missing, of another shape, or changes within a trajectory.
        """
        theta = trajectories.get(self.theta, None)
        if theta is None:
            raise BadInput(f"the simulations have no key {self.theta!r}", "give the parameters that made each of them")
        if theta.ndim == 2:
            return theta
        if theta.ndim != 3:
            raise BadInput(f"{self.theta!r} has shape {tuple(theta.shape)}", "needs (B, P), or (B, T, P)")
        first = theta[:, 0]
        moved = (theta != first.unsqueeze(1)).any(-1) & torch.isfinite(first).all(-1, keepdim=True)
        moved = moved & self._mask(trajectories, theta.shape[:2]).to(moved.device)
        if bool(moved.any()):
            row, step = moved.nonzero()[0].tolist()
            raise BadInput(
                f"{self.theta!r} changes in trajectory {row} at step {step}: another world begins there",
                "cut trajectories where episodes end: Collector(split_trajs=True), or the mask",
            )
        return first

    @property
    def _told(self) -> tuple[NestedKey, NestedKey, NestedKey]:
        return self.observation, self.action, self.following

    def _values(self, trajectories: TensorDictBase) -> list[Tensor]:
        """Observation, action and next observation, of matching shapes."""
        found = [trajectories.get(key, None) for key in self._told]
        for key, value in zip(self._told, found, strict=True):
            if value is None:
                present = sorted(map(str, trajectories.keys(True)))
                raise BadInput(f"the trajectories have no key {key!r}; they have {present}", "see TrajectoryKeys")
            if value.ndim != 3:
                raise BadInput(f"{key!r} has shape {tuple(value.shape)}", SHAPE_CURE)
        shapes = [tuple(value.shape) for value in found]
        if len({shape[:2] for shape in shapes}) > 1 or shapes[0] != shapes[2] or not trajectories.batch_dims:
            told = ", ".join(f"{key!r} {shape}" for key, shape in zip(self._told, shapes, strict=True))
            raise BadInput(
                f"{told}, batch size {tuple(trajectories.shape)}", "needs the same (trajectories, steps) for all"
            )
        if not shapes[0][0]:
            raise BadInput("there is no trajectory", "give one at least")
        return found

    def _blame_theta(self, trajectories: TensorDictBase, row: int) -> None:
        """Raise if theta is no number: then its trajectory cannot be any better."""
        theta = trajectories.get(self.theta, None)
        if theta is not None and not bool(torch.isfinite(theta[row]).all()):
            raise BadInput(f"theta of trajectory {row} is not finite", "draw it anew, or leave the trajectory out")

    def _mask(self, trajectories: TensorDictBase, shape: torch.Size) -> Bool[Tensor, "B T"]:
        for key in (self.mask, *ELSEWHERE):
            found = trajectories.get(key, None)
            if found is None:
                continue
            # pad_sequence gives every entry a mask of its own.
            leaves = list(found.values(True, True)) if isinstance(found, TensorDictBase) else [found]
            if any(leaf.dtype != torch.bool or leaf.shape not in (shape, (*shape, 1)) for leaf in leaves):
                told = ", ".join(f"{leaf.dtype} {tuple(leaf.shape)}" for leaf in leaves)
                raise BadInput(f"the mask under {key!r} is {told}", f"trajectories of shape {tuple(shape)} need bool")
            return torch.stack([leaf.reshape(shape) for leaf in leaves]).all(0)
        return torch.ones(shape, dtype=torch.bool)


def frame_of(theta: Float[Tensor, "B P"], box: Box) -> Float[Tensor, "B P"]:
    """z of theta, in the coordinates of a box.

    Raises:
        BadInput: theta of another width, no number, or outside the box by more than rounding.
    """
    if theta.shape[-1] != len(box.space):
        raise BadInput(
            f"theta has {theta.shape[-1]} columns", f"needs {len(box.space)}, in this order: {', '.join(box.space)}"
        )
    z = box.to_frame(theta)
    wrong = ~((z >= -ROUNDING) & (z <= 1 + ROUNDING)).all(-1)
    if bool(wrong.any()):
        row, finite = int(wrong.nonzero()[0]), bool(torch.isfinite(theta[wrong]).all())
        told, count = [float(f"{x:.4g}") for x in theta[row].tolist()], int(wrong.sum())
        raise BadInput(
            f"theta = {told} of trajectory {row} ({count} such) "
            + ("lies outside the estimator's box" if finite else "is not finite"),
            "train on simulations drawn inside the box, or leave the others out",
        )
    return z.clamp(0, 1)
