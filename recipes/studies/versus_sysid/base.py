"""No method at all: the engineer's model, its free parameters fitted, nothing added."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import Windows
from recipes.studies.versus_sysid.ours import replayed
from recipes.studies.versus_sysid.task import Claim, Fitted, Task


@final
@dataclass(frozen=True)
class Plain(Fitted):
    """The engineer's model; see :class:`Task`."""

    task: Task
    claims: tuple[Claim, ...] = ()

    def predict(self, windows: Windows) -> Float[Tensor, "W K S"]:
        """See :class:`Fitted`."""
        return replayed(self.task.simulator, self.task.base_theta, windows)


def fit(task: Task) -> Plain:
    """As criticism fits it."""
    return Plain(task)
