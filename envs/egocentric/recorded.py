"""Recorded predictions: what a motion and a vision network said of each of 792 seconds, and what a policy chose.

    vision_i = the class that most of the ten frames of second i voted for, the lowest of several

Source: the published predictions of Possas et al., "Egocentric Activity Recognition on a Budget" (CVPR 2018). A row
names neither its sequence nor its second; within a class, rows of one sequence follow each other.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from envs.egocentric.sequences import CLASSES, rows_of
from onlinebayes.runs import BadInput

FRAMES = 10
MOTION, VISION = 0, 1
"""The two actions."""


@dataclass(frozen=True)
class Recorded:
    """N seconds: the activity, and the class that each sensor's network says.

    Attributes:
        label, motion, vision: classes in [0, 20).
    """

    label: Int[Tensor, " N"]
    motion: Int[Tensor, " N"]
    vision: Int[Tensor, " N"]

    @property
    def motion_right(self) -> Bool[Tensor, " N"]:
        """True where the motion network is right."""
        return self.motion == self.label

    @property
    def vision_right(self) -> Bool[Tensor, " N"]:
        """True where the vision network is right."""
        return self.vision == self.label

    def vision_rate(self) -> Float[Tensor, " 20"]:
        """Return the share of seconds in which the vision network is right, for each activity.

        Raises:
            BadInput: an activity has no row.
        """
        number = torch.bincount(self.label, minlength=CLASSES)
        if bool((number == 0).any()):
            missing = int((number == 0).nonzero()[0])
            raise BadInput(f"activity {missing} has no recorded row", "give predictions of all 20 activities")
        return torch.bincount(self.label, self.vision_right.double(), CLASSES).float() / number


@dataclass(frozen=True)
class PolicyRun:
    """Record of a published policy on N seconds.

    Attributes:
        label, said: the activity and the answer, in [0, 20).
        action: MOTION or VISION.
    """

    label: Int[Tensor, " N"]
    said: Int[Tensor, " N"]
    action: Int[Tensor, " N"]


def read_predictions(path: str | Path) -> Recorded:
    """``predictions.csv``.

    Raises:
        BadInput: the file or a column is missing, or a value is no class.
    """
    columns = ("label", "pred_motion", *(f"pred_vision_frame{k}" for k in range(FRAMES)))
    table = _whole(path, columns, CLASSES)
    votes = torch.nn.functional.one_hot(table[:, 2:], CLASSES).sum(1)
    return Recorded(table[:, 0], table[:, 1], votes.argmax(1))


def read_policy_run(path: str | Path) -> PolicyRun:
    """One ``*_rows.csv`` of the folder ``policy_runs``.

    Raises:
        BadInput: the file or a column is missing, or a value is no class.
    """
    return PolicyRun(*_whole(path, ("label", "pred", "action_0motion_1vision"), CLASSES).unbind(1))


def made_up_predictions(number: int = 400, generator: torch.Generator | None = None) -> Recorded:
    """Rows that nobody recorded: vision is right in 85 %, motion in 95 % of ten activities and 20 % of the others."""
    label = torch.arange(number) % CLASSES

    def said(rate: Callable[[Tensor], Tensor]) -> Tensor:
        wrong = (label + 1 + torch.randint(CLASSES - 1, (number,), generator=generator)) % CLASSES
        return torch.where(torch.rand(number, generator=generator) < rate(label), label, wrong)

    moving = said(lambda label: torch.where(label < CLASSES // 2, 0.95, 0.2))
    return Recorded(label, moving, said(lambda label: torch.full((number,), 0.85)))


def _whole(path: str | Path, columns: tuple[str, ...], below: int) -> Int[Tensor, "N C"]:
    """Columns of whole numbers in [0, below)."""
    rows = rows_of(Path(path), columns)
    for line, row in enumerate(rows, 2):
        for name, value in zip(columns, row, strict=True):
            if not value.isdecimal() or int(value) >= below:
                raise BadInput(
                    f"row {line}: {name} = '{value}'", f"needs a whole number in 0..{below - 1}", where=str(path)
                )
    return torch.tensor([[int(value) for value in row] for row in rows])
