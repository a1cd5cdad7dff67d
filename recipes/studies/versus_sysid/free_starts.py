"""``mujoco.sysid`` on the whole of what criticism's fit solves: the parameters and the start of every window.

    min over x in bounds and starts s_w of sum over windows |(measured - simulated(x, s_w)) / noise|^2

Each start's 2 J numbers are a parameter of sysid's. Its differences are dense: a column for each number of each start,
all windows in one rollout of every column (see :mod:`.sysid`), where ours moves all windows' starts at once and solves
for each apart (`onlinebayes.identification.fitting.rows`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np
import torch
from mujoco import sysid
from numpy import ndarray

from recipes.studies.versus_sysid.sysid import Problem

REACH = 100.0  # how far a start may move [spread of the measured starts]: no bound is in its way


@final
@dataclass(frozen=True)
class FreeStarts:
    """A least-squares problem as ``mujoco.sysid`` takes it.

    Args:
        problem: the same with starts as smoothed.
    """

    problem: Problem

    @property
    def parameters(self) -> sysid.ParameterDict:
        """The problem's, then the starts, window by window, at their smoothed values."""
        found, start = self.problem.parameters, self.problem.task.fit_windows.start.numpy()
        far = REACH * (np.ptp(start, axis=0) + 1)
        for window, row in enumerate(start):
            found.add(sysid.Parameter(f"start{window}", row, row - far, row + far))
        return found

    def residual(self, x: ndarray, params: sysid.ParameterDict) -> tuple[list[ndarray], list[Any], list[Any]]:
        """Weighed residuals, a column for each column of x."""
        del params
        columns = [self._column(values) for values in x.reshape(len(x), -1).T]
        return [np.stack(columns, 1) if x.ndim > 1 else columns[0]], [], []

    def _column(self, x: ndarray) -> ndarray:
        own, windows = len(self.problem.freed), self.problem.task.fit_windows
        start = torch.from_numpy(np.ascontiguousarray(x[own:].reshape(windows.start.shape)))
        return self.problem.weighed(x[:own], replace(windows, start=start), self.problem.parameters)
