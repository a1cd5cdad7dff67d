"""The recorded rows: a table over the motion predictor's class says where the camera pays, judged on rows it never saw.

    gain(c) = sum over rows with motion class c of (vision right - motion right) / (their number + 1)
    accuracy(u) : the camera in the u N rows of the highest gain, where equal gains share what is left

The rows name no sequence. Folds are by row; or by block, ten contiguous tenths of each activity, the nearest that there
is to folds by sequence, as rows of one sequence stand together.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float, Int
from torch import Tensor

from envs.egocentric import CLASSES, Recorded

FOLDS = 10


def by_row(rows: Recorded, generator: torch.Generator) -> Int[Tensor, " N"]:
    """A fold for each row, each activity's rows spread over all folds."""
    fold = torch.empty_like(rows.label)
    for label in rows.label.unique():
        mine = (rows.label == label).nonzero().squeeze(-1)
        fold[mine] = torch.randperm(len(mine), generator=generator) % FOLDS
    return fold


def by_block(rows: Recorded) -> Int[Tensor, " N"]:
    """A fold for each tenth of an activity's rows."""
    fold = torch.empty_like(rows.label)
    for label in rows.label.unique():
        mine = (rows.label == label).nonzero().squeeze(-1)
        fold[mine] = torch.arange(len(mine)) * FOLDS // len(mine)
    return fold


def gains(rows: Recorded, fold: Int[Tensor, " N"]) -> Float[Tensor, " N"]:
    """The gain of each row's motion class, from the rows of the other folds."""
    better = rows.vision_right.double() - rows.motion_right.double()
    result = torch.empty_like(better)
    for k in fold.unique():
        other = fold != k
        total = torch.bincount(rows.motion[other], better[other], CLASSES)
        number = torch.bincount(rows.motion[other], minlength=CLASSES)
        result[~other] = (total / (number + 1))[rows.motion[~other]]
    return result


def accuracy_over_use(rows: Recorded, gain: Float[Tensor, " N"], uses: Sequence[float]) -> Float[Tensor, " U"]:
    """Accuracy where the camera is used in a share of the rows; rows of equal gain are expected to share it."""
    better = rows.vision_right.double() - rows.motion_right.double()
    _, place, number = gain.unique(return_inverse=True, return_counts=True)
    level = (torch.zeros(len(number)).double().index_add_(0, place, better) / number)[place]
    total = torch.nn.functional.pad(level[gain.argsort(descending=True)].cumsum(0), (1, 0)) / len(gain)
    at = torch.tensor(uses).double() * len(gain)
    low = at.floor().long().clamp(max=len(gain) - 1)
    return rows.motion_right.double().mean() + torch.lerp(total[low], total[low + 1], at - low)


def mix_over_use(rows: Recorded, uses: Sequence[float]) -> Float[Tensor, " U"]:
    """Accuracy of a random mix."""
    motion, vision = rows.motion_right.double().mean(), rows.vision_right.double().mean()
    return motion + (vision - motion) * torch.tensor(uses).double()
