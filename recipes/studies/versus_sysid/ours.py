"""Ours: ``refine`` with all candidates, as a user of the command line gets it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import Criticism, refine
from onlinebayes.identification import Windows, rollout, sensor_readings
from onlinebayes.simulators.identifiable import Identifiable
from recipes.studies.versus_sysid.task import Claim, Fitted, Task


@final
@dataclass(frozen=True)
class Refined(Fitted):
    """The model that refine ended with.

    Args:
        task: what it was fitted to.
        result: what refine said.
    """

    task: Task
    result: Criticism

    @property
    def claims(self) -> tuple[Claim, ...]:  # type: ignore[override]
        """The accepted effects; the first one with those that it is said to be indistinguishable from."""
        equal = {c.effect: c.indistinguishable_from for c in self.result.candidates}
        return tuple(frozenset({key, *equal.get(key, ())}) for key in self.result.accepted)

    def predict(self, windows: Windows) -> Float[Tensor, "W K S"]:
        """See :class:`Fitted`."""
        return replayed(self.result.final.simulator, self.result.final.theta, windows)


def fit(task: Task) -> Refined:
    """Refine the engineer's model with all candidates; the held-out runs go along, as the product has it."""
    result = refine(task.simulator, task.measurement, holdout=task.holdout, selection=task.selection)
    return Refined(task, result)


def replayed(model: Identifiable, theta: Float[Tensor, " P"], windows: Windows) -> Float[Tensor, "W K S"]:
    """Signals of a model over windows; nan from the row on in which it diverged."""
    trajectory = rollout(model, windows, theta[None], windows.start[None])
    signals = sensor_readings(model, windows, theta[None], windows.start[None], trajectory)[0]
    valid = trajectory["valid"][0, ..., None] & torch.isfinite(signals)
    return torch.where(valid, signals, torch.nan)
