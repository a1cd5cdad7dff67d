"""Input and output of every method: the same runs, the same held-out windows.

The held-out windows are criticism's own: one second, tiled without overlap, from the smoothed measured starts. They
are cut once, from the engineer's model, so that all methods predict the same rows from the same starts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import Selection
from onlinebayes.identification import (
    MEMORY,
    Windows,
    fit_base,
    make_windows,
    measured_floors,
    noise_floors,
    row_step,
    run_grids,
    split,
    steady,
)
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.mujoco import MujocoSimulator

Claim = frozenset[str]
"""Names ``effect@target`` that a method cannot tell from one another; right if one of them is."""


@final
@dataclass(frozen=True)
class Task:
    """One case as a method gets it.

    Args:
        name: of the case.
        simulator: the engineer's model with its free parameters, on one thread.
        measurement: all runs.
        holdout: names of the held-out ones.
        selection: how criticism judges.
    """

    name: str
    simulator: MujocoSimulator
    measurement: Measurement
    holdout: tuple[str, ...]
    selection: Selection = field(default_factory=Selection)

    @cached_property
    def fit_runs(self) -> Measurement:
        """The runs that may be fitted."""
        return split(self.measurement, self.holdout)[0]

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the S measured signals."""
        return tuple(signal.name for signal in self.measurement.signals)

    @cached_property
    def noise(self) -> Float[Tensor, " S"]:
        """Floor of each signal, from the fit runs [SI]."""
        grids = run_grids(self.fit_runs, row_step(self.fit_runs))
        return noise_floors(self.fit_runs.signals, grids).to(self.fit_runs.data["signal"])

    @cached_property
    def steadied(self) -> Selection:
        """The selection with the horizon that criticism uses, which is everybody's."""
        return steady(self.simulator, self.fit_runs, self.selection)

    @cached_property
    def fit_windows(self) -> Windows:
        """The fit runs in windows of one horizon, from smoothed starts."""
        return self._windows(self.fit_runs)

    @cached_property
    def held_windows(self) -> Windows:
        """The held-out runs likewise."""
        return self._windows(split(self.measurement, self.holdout)[1])

    @cached_property
    def base_theta(self) -> Float[Tensor, " P"]:
        """The engineer's model fitted by criticism, nothing added: where sysid begins [SI]."""
        return fit_base(self.simulator, self.fit_runs, measured_floors(self.fit_runs)).fitted.theta

    def _windows(self, runs: Measurement) -> Windows:
        horizon = self.steadied.horizon_s
        return make_windows(self.simulator, runs, horizon, MEMORY * horizon, self.noise, inset=True)


@final
@dataclass(frozen=True)
class Fitted:
    """A model fitted to a task's fit runs.

    Args:
        claims: what it says is missing in the engineer's model.
        predict: windows -> signals (W, K, S) at their rows [SI], open loop from their starts under their commands; nan
            where it diverged. What was measured in the windows is not looked at.
    """

    claims: tuple[Claim, ...]
    predict: Callable[[Windows], Tensor]


def rms(windows: Windows, simulated: Float[Tensor, "W K S"]) -> Float[Tensor, " S"]:
    """Root-mean-square error of each signal over all measured rows [SI]; inf where it diverged."""
    wrong = (simulated - windows.value).square().nan_to_num(nan=float("inf"), posinf=float("inf"))
    squares = torch.where(windows.measured, wrong, torch.zeros_like(wrong)).sum((0, 1))
    return (squares / windows.measured.sum((0, 1)).clamp_min(1)).sqrt()
