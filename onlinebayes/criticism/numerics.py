"""Is the integration step fine enough to judge by: the replay at a quarter of it must hardly move.

    e = RMS of the start-projected difference between the replays at h and h / 4,    fine enough: e < RMS residual / 10

Criticism begins at a coarse step, where that is cheap, and goes down a ladder of steps as the model improves and its
residual shrinks. Steps longer than the rows are only taken while the residual is far above the sensors' noise, for they
leave measured rows out.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates import DEAD_TIME
from onlinebayes.criticism.fit import Fit, fit, starting_theta
from onlinebayes.criticism.grid import even_step
from onlinebayes.criticism.projection import noise_rows, project
from onlinebayes.criticism.replay import replay
from onlinebayes.criticism.results import Numerics
from onlinebayes.criticism.tiling import BINS
from onlinebayes.criticism.windows import Windows, make_windows
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

SHARE = 0.1
FAR = 10.0  # residual over noise above which rows may be left out


@dataclass(frozen=True)
class Grounds:
    """What everything is judged on: windows at one integration step, the model fitted to them, and how fine that is."""

    windows: Windows
    fitted: Fit
    numerics: Numerics


def settle(
    simulator: Simulator,
    measurement: Measurement,
    horizon: float,
    noise: Float[Tensor, " S"],
    begin: Float[Tensor, " P"] | None = None,
    before: Grounds | None = None,
    fitted: Fit | None = None,
) -> Grounds:
    """Fit at the coarsest step of the ladder at which the numerics do not matter.

    Args:
        simulator: at the model's own step.
        measurement: the fit runs.
        horizon: H [s].
        noise: floor of each signal [SI].
        begin: theta at which the fit begins; searched in the box when None.
        before: the grounds of the model that this one grew from: its step is the ladder's first.
        fitted: a fit of this model to those grounds' windows, if there is one.
    """
    grounds: Grounds | None = None
    starts: Float[Tensor, "W J2"] | None = None
    for timestep in ladder(simulator, measurement, horizon):
        if before is not None and timestep > before.fitted.simulator.timestep * (1 + 1e-9):
            continue
        stepped = at_step(simulator, timestep)
        try:
            if before is not None and timestep == before.fitted.simulator.timestep:
                windows = before.windows
            else:
                windows, fitted = make_windows(stepped, measurement, horizon, DEAD_TIME * horizon, noise), None
            begin = starting_theta(stepped, windows) if begin is None else begin
            if starts is not None and starts.shape != windows.start.shape:
                starts = None  # a finer clock fits another window into a run
            fitted = fitted or fit(stepped, windows, begin, starts=starts)
        except BadInput:
            if timestep <= simulator.timestep:
                raise
            continue
        begin, starts = fitted.theta, fitted.lin.starts
        grounds = Grounds(windows, fitted, check(simulator, measurement, windows, fitted))
        if grounds.numerics.sufficient:
            return grounds
        if timestep <= simulator.timestep and not adjustable(simulator):
            return grounds
    assert grounds is not None
    return grounds


def ladder(simulator: Simulator, measurement: Measurement, horizon: float) -> list[float]:
    """Steps to try, coarse to fine: from H / 100 in halves down to the model's own, then a quarter and a sixteenth."""
    own = simulator.timestep
    if not adjustable(simulator):
        return [own]
    factor = max(1, int(horizon / BINS / own + 1e-9))
    steps = []
    while factor > 1:
        steps.append(factor * own)
        factor //= 2
    return [*steps, own, own / 4, own / 16]


def adjustable(simulator: Simulator) -> bool:
    """Whether the simulator can integrate with another step."""
    return type(simulator).with_timestep is not Simulator.with_timestep


def at_step(simulator: Simulator, timestep: float) -> Simulator:
    """The simulator at that step; itself where it has it already."""
    return simulator if timestep == simulator.timestep else simulator.with_timestep(timestep)


def check(simulator: Simulator, measurement: Measurement, windows: Windows, fitted: Fit) -> Numerics:
    """Replay at a quarter of the step and compare, starts projected out.

    Args:
        simulator: any step of the fitted model's family, to tell whether its step can change.
        measurement: the runs the windows were cut from.
        windows, fitted: what is checked.
    """
    timestep = fitted.simulator.timestep
    long = project(windows, fitted.lin)
    count = (long.row_weight > 0).sum()
    rms = float((long.residual.square().sum() / count).sqrt())
    if not adjustable(simulator):
        return Numerics(timestep, float("nan"), True)
    moved = step_difference(measurement, windows, fitted, timestep / 4)
    rows = noise_rows(windows, moved[..., None])
    error = float((long.project(rows).square().sum() / count).sqrt())
    leaves_out = windows.step > even_step(measurement, min(timestep, simulator.timestep)) * (1 + 1e-9)
    sufficient = error < SHARE * max(rms, 0.1) and not (leaves_out and rms < FAR)
    return Numerics(timestep, error, sufficient)


def step_difference(measurement: Measurement, windows: Windows, fitted: Fit, timestep: float) -> Float[Tensor, "W n S"]:
    """How the binned replay moves when it is integrated with another step."""
    finer = fitted.simulator.with_timestep(timestep)
    fine = make_windows(finer, measurement, windows.horizon, DEAD_TIME * windows.horizon, like=windows)
    theta, starts = fitted.theta[None], fitted.lin.starts[None]
    coarse_signals, _ = replay(fitted.simulator, windows, theta, starts)
    fine_signals, valid = replay(finer, fine, theta, starts)
    ratio = fine.rows // windows.rows
    moved = windows.bin(fine_signals[0, :, ratio - 1 :: ratio] - coarse_signals[0])
    return torch.where(valid[0][:, None, None], moved, torch.full_like(moved, float("inf")))
