"""Is the integration step fine enough to judge by: the replay at a quarter of it must hardly move.

    e = RMS of the start-projected difference between the replays at h and h / 4,    fine enough: e < RMS residual / 10

Criticism begins on the coarsest rung of the ladder, where that is cheap, and goes down as the model improves and its
residual shrinks; rungs whose error is too large even beside the residual before a fit are passed by, and where the
model's own method is of first order those whose error a coarser one foretells. Steps longer than the rows are only
taken while the residual is far above the sensors' noise, for they leave measured rows out. Where rows jitter, or
commands change between them, the finer replay is driven on a finer clock: what averaged commands cost is in e, too. In
the end the model as it was given, or its own soft friction, is preferred where it follows the log far better
(:mod:`.as_run`); soft friction, which needs no such fine steps, where a rung is too coarse for friction that sticks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.grid import even_step, row_step
from onlinebayes.identification.data.windows import MEMORY, Windows, make_windows
from onlinebayes.identification.fitting.as_run import NOISE_FLOORS, AsRun, RunSetup, as_run, with_soft_friction
from onlinebayes.identification.fitting.fit import Fit, improve, unfitted
from onlinebayes.identification.fitting.inactive_effects import restart_inactive_effects
from onlinebayes.identification.fitting.initial_theta import from_elsewhere, starting_theta
from onlinebayes.identification.fitting.projection import Projected, misfit, noise_rows, project
from onlinebayes.identification.replaying.instants import read_between
from onlinebayes.identification.replaying.ladder import Rung, adjustable, first_order, ladder
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.identification.results import Numerics
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.identifiable import Identifiable

STEP_ERROR_SHARE = 0.1
"""The integration error may be this share of the residual."""

LEAST_RESIDUAL = 0.1
"""A residual of less noise than this asks for no finer step."""

SURELY_TOO_COARSE = 2.0
"""A rung of which so many times the admissible error is expected is passed by unseen."""

FLAT_BELOW = 1e-6
"""A direction whose singular value over the largest is less than this is flat."""

ROWS_MATTER_BELOW = 10.0
"""While the residual is more noise than this, measured rows may be left out."""


@dataclass(frozen=True)
class Grounds:
    """What everything is judged on: windows at one integration step, the model fitted to them, and how fine that is.

    ``shift`` is by how much the step moves theta [SI]: see :func:`check`.
    """

    windows: Windows
    fitted: Fit
    numerics: Numerics
    rung: Rung
    shift: Float[Tensor, " P"]


def settle(
    simulator: Identifiable,
    measurement: Measurement,
    horizon: float,
    noise: Float[Tensor, " S"],
    begin: Float[Tensor, " P"] | None = None,
    before: Grounds | None = None,
    fitted: Fit | None = None,
    like: Rung | None = None,
) -> Grounds:
    """Fit on the coarsest rung of the ladder at which the numerics do not matter.

    Args:
        simulator: as the user gave it, with the effects added so far.
        measurement: the fit runs.
        horizon: H [s].
        noise: floor of each signal [SI].
        begin: theta at which the fit begins; searched in the box when None.
        before: the grounds of the model that this one grew from: its rung is the first one here.
        fitted: a fit of this model to those grounds' windows, if there is one.
        like: a rung whose friction and moments all rungs have.
    """
    setup, afar = RunSetup(simulator, measurement, horizon, thorough=before is None), begin is None
    rungs = _rungs(ladder(simulator, horizon, row_step(measurement)), before, like)
    grounds: Grounds | None = None
    starts: Float[Tensor, "W J2"] | None = None
    for rung in rungs:
        last, first = rung == rungs[-1], grounds is None
        if grounds is not None and not last and _too_coarse(simulator, grounds, rung):
            continue
        stepped, same = rung.of(simulator), before if before is not None and rung == before.rung else None
        known = fitted if same is not None else None
        try:
            windows = same.windows if same else make_windows(stepped, measurement, horizon, MEMORY * horizon, noise)
            begin = starting_theta(stepped, windows) if begin is None else begin
            if starts is not None and starts.shape != windows.start.shape:
                starts = None  # a finer clock fits another window into a run
            here = known or unfitted(stepped, windows, begin, starts=starts)
        except Stopped:
            raise  # what a coarser rung has was not fitted
        except BadInput:
            # Too coarse a step may not fit the windows, or make the model diverge; a finer one follows.
            if last and first:
                raise
            continue
        grounds = _checked(setup, rung, windows, here)
        # A fit only lowers the residual: numerics that matter before it matter after it, and the rung is passed by.
        first = first and before is None
        if known is None and (grounds.numerics.sufficient or first or last):
            grounds = _improved(setup, grounds, begin if first and afar else None)
        begin, starts = grounds.fitted.theta, grounds.fitted.lin.starts
        if grounds.numerics.sufficient:
            break
        if not last and (softer := _with_soft_friction(setup, grounds)) is not None:
            return softer
    assert grounds is not None
    return _as_run(setup, grounds)


def _rungs(rungs: Sequence[Rung], before: Grounds | None, like: Rung | None) -> list[Rung]:
    """The ladder from the rung of the grounds before on, run like that; all of it without any."""
    if before is not None:
        return _from(before.rung, rungs)
    return [rung.like(like) for rung in rungs] if like is not None else list(rungs)


def _checked(setup: RunSetup, rung: Rung, windows: Windows, fitted: Fit) -> Grounds:
    """A fit on one rung, with how fine that is."""
    numerics, shift = check(setup.simulator, setup.measurement, windows, fitted)
    return Grounds(windows, fitted, numerics, rung, shift)


def _improved(setup: RunSetup, grounds: Grounds, begun: Float[Tensor, " P"] | None) -> Grounds:
    """The model fitted to convergence on the same rung; from elsewhere too where ``begun`` is a searched theta [SI]."""
    windows = grounds.windows
    fitted = improve(grounds.fitted, windows)
    if begun is not None:
        fitted = restart_inactive_effects(from_elsewhere(fitted, windows, begun), windows)
    # An effect that was nothing before the fit may err by much after it: a dead time does, and dry friction.
    return _checked(setup, grounds.rung, windows, fitted)


def _from(first: Rung, rungs: Sequence[Rung]) -> list[Rung]:
    """A rung and those below it; all where it is none of the ladder's, with its own friction and moments."""
    rungs = [rung.like(first) for rung in rungs]
    return rungs[rungs.index(first) :] if first in rungs else [first, *rungs]


def _with_soft_friction(setup: RunSetup, coarse: Grounds) -> Grounds | None:
    """The model settled with MuJoCo's soft friction, where that leaves noise and friction that sticks will not.

    Asked on a rung that is too coarse, for friction that sticks takes far finer ones: what is left beside the error of
    integration tells. None where the model goes on as it is.
    """
    if _beside_integration(coarse) <= NOISE_FLOORS:
        return None
    found = with_soft_friction(setup, AsRun(coarse.rung, coarse.windows, coarse.fitted))
    softer = None if found is None else _checked(setup, found.rung, found.windows, found.fitted)
    if softer is None or _beside_integration(softer) > NOISE_FLOORS:
        return None
    fitted, noise = softer.fitted, softer.windows.noise
    soft = settle(setup.simulator, setup.measurement, setup.horizon, noise, fitted.theta, softer, fitted)
    return soft if misfit(soft.fitted.projected) <= NOISE_FLOORS else None


def _beside_integration(grounds: Grounds) -> float:
    """What a fit leaves that is not the error of its step [floors]."""
    return math.sqrt(max(0.0, misfit(grounds.fitted.projected) ** 2 - grounds.numerics.error_at_quarter_step**2))


def _as_run(setup: RunSetup, grounds: Grounds) -> Grounds:
    """These grounds, or those of the model run more like its own: see :mod:`.as_run`."""
    found = as_run(setup, AsRun(grounds.rung, grounds.windows, grounds.fitted))
    if found is None:
        return grounds
    if found.rung == grounds.rung.like(found.rung):
        # Less is left, and what is soft, or of other moments, may ask for another step.
        noise, begin = found.windows.noise, found.fitted.theta
        return settle(setup.simulator, setup.measurement, setup.horizon, noise, begin, like=found.rung)
    own = _checked(setup, found.rung, found.windows, found.fitted)
    # The parameters are those of this step: what a finer one would make of them is no doubt about them.
    certain, numerics = torch.zeros_like(own.shift), replace(own.numerics, sufficient=True)
    return replace(own, numerics=numerics, shift=certain)


def check(
    simulator: Identifiable, measurement: Measurement, windows: Windows, fitted: Fit
) -> tuple[Numerics, Float[Tensor, " P"]]:
    """Replay at a quarter of the step and compare, starts projected out.

    Args:
        simulator: any step of the fitted model's family, to tell whether its step can change.
        measurement: the runs the windows were cut from.
        windows, fitted: what is checked.

    Returns:
        How fine the step is, and by how much theta would move if it were infinitely fine, to first order in h: 4/3 of
        what the difference of the two replays asks for; 0 where the step cannot change or a world diverged.
    """
    timestep = fitted.simulator.timestep
    long = project(windows, fitted.lin)
    count = (long.row_weight > 0).sum()
    rms = _rms(long)
    if not adjustable(simulator):
        return Numerics(timestep, float("nan"), True), torch.zeros_like(fitted.theta)
    moved = step_difference(measurement, windows, fitted, timestep / 4)
    rows = long.project(noise_rows(windows, moved[..., None]))
    error = float((rows.square().sum() / count).sqrt())
    too_few_rows = rms < ROWS_MATTER_BELOW and _leaves_out(simulator, measurement, windows, fitted)
    fine_enough = error < STEP_ERROR_SHARE * max(rms, LEAST_RESIDUAL)
    return Numerics(timestep, error, fine_enough and not too_few_rows), _shift(
        long.columns.flatten(0, 1), rows.flatten()
    )


def _rms(projected: Projected) -> float:
    """Of the residual, starts projected out [noise]."""
    return float((projected.residual.square().sum() / (projected.row_weight > 0).sum()).sqrt())


def _leaves_out(simulator: Identifiable, measurement: Measurement, windows: Windows, fitted: Fit) -> bool:
    """Whether the windows' rows are further apart than the measured ones."""
    finest = min(fitted.simulator.timestep, simulator.timestep)
    return windows.step > even_step(measurement, finest) * (1 + 1e-9)


def _too_coarse(simulator: Identifiable, coarser: Grounds, rung: Rung) -> bool:
    """Whether a method of first order, whose error falls as its step does, will err by too much on a rung."""
    if not rung.method == coarser.rung.method == "own" or not first_order(simulator):
        return False
    expected = coarser.numerics.error_at_quarter_step * rung.timestep / coarser.rung.timestep
    return expected > SURELY_TOO_COARSE * STEP_ERROR_SHARE * max(_rms(coarser.fitted.projected), LEAST_RESIDUAL)


def _shift(columns: Float[Tensor, "N P"], moved: Float[Tensor, " N"]) -> Float[Tensor, " P"]:
    """The step of theta that follows a change of the replay, as far as that is determined [SI]."""
    scale = columns.norm(dim=0).clamp_min(1e-300)
    if not columns.shape[1] or not bool(torch.isfinite(moved).all()):
        return torch.zeros_like(scale)
    asked = torch.linalg.pinv(columns / scale, rtol=FLAT_BELOW) @ moved
    return 4 / 3 * asked / scale


def step_difference(measurement: Measurement, windows: Windows, fitted: Fit, timestep: float) -> Float[Tensor, "W n S"]:
    """How the binned replay moves when it is integrated with another step, on the clock that this step asks for."""
    finer = fitted.simulator.with_timestep(timestep)
    fine = make_windows(finer, measurement, windows.horizon, MEMORY * windows.horizon, like=windows)
    theta, starts = fitted.theta[None], fitted.lin.starts[None]
    coarse_signals, _ = replay(fitted.simulator, windows, theta, starts)
    fine_signals, valid = replay(finer, replace(fine, late=None), theta, starts)
    rows = torch.arange(1, windows.rows + 1, device=theta.device)[:, None].to(theta)
    late = torch.zeros_like(windows.value) if windows.late is None else windows.late
    there = read_between(fine_signals[0], (rows + late) * (fine.rows // windows.rows) - 1)
    moved = windows.bin(there - coarse_signals[0])
    return torch.where(valid[0][:, None, None], moved, torch.full_like(moved, float("inf")))
