"""What every method is given, and what it gives back: the same runs, the same held-out windows, one small interface.

    fit(task) -> Fitted,      Fitted.predict(windows) = signals at the windows' rows,      Fitted.claims = names

The held-out windows are criticism's own: one second, tiled without overlap, from the smoothed measured starts. They
are cut once, from the engineer's model, so that all methods predict the same rows from the same starts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
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
        shapes: ``effect@target.parameter`` -> true value [SI] of what a linear library must know beforehand (a dead
            time, a number of poles): for the peer whose library has to hold the true term.
    """

    name: str
    simulator: MujocoSimulator
    measurement: Measurement
    holdout: tuple[str, ...]
    selection: Selection = field(default_factory=Selection)
    shapes: Mapping[str, float] = field(default_factory=dict)

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


class Fitted(ABC):
    """A model fitted to a task's fit runs.

    Attributes:
        claims: what it says is missing in the engineer's model.
    """

    claims: tuple[Claim, ...]

    @abstractmethod
    def predict(self, windows: Windows) -> Float[Tensor, "W K S"]:
        """Signals at the windows' rows [SI], open loop from their starts under their commands; nan where it diverged.

        What was measured in the windows must not be looked at.
        """


def open_loop_error(windows: Windows, simulated: Float[Tensor, "*batch W K S"]) -> Float[Tensor, "*batch W S"]:
    """Sum of squares of measured - simulated over each window's measured rows [SI squared]; inf where it diverged."""
    wrong = (simulated - windows.value).square().nan_to_num(nan=float("inf"), posinf=float("inf"))
    return torch.where(windows.measured, wrong, torch.zeros_like(wrong)).sum(-2)


def rms(windows: Windows, simulated: Float[Tensor, "W K S"]) -> Float[Tensor, " S"]:
    """Root-mean-square error of each signal over all measured rows [SI]."""
    return (open_loop_error(windows, simulated).sum(0) / windows.measured.sum((0, 1)).clamp_min(1)).sqrt()
