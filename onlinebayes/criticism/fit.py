"""Theta fitted to convergence: Gauss-Newton with Levenberg's damping, bounds as the prior, starts projected out.

    min over theta in bounds of |r~(theta)|^2,     step:  min |r~ - C~ d|^2 + lambda |D d|^2,  low <= theta + d <= high

with D^2 = diag(C~' C~) (Marquardt 1963). The undamped step is tried first. One replay, projected as before the step,
tells whether it can be taken; only then is the new point linearised, which costs a replay for each parameter and start.
The last step, which promises next to nothing, keeps the derivatives.
Once a step is rejected, no damping and all dampings are replayed at once before each step, until none is the best
again: where a kink or a curved valley makes one undamped step too long it makes the next one, too. Where all of these
are refused far from the optimum, parts of the step of theta and starts together are tried. A world that diverges
rejects its step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.bounded import bounded_least_squares
from onlinebayes.criticism.projection import Projected, project, row_weights, start_shift
from onlinebayes.criticism.replay import replay
from onlinebayes.criticism.sensitivities import Linearisation, linearise
from onlinebayes.criticism.strays import (
    best_starts,
    misfits,
    residual_rows,
    settled_starts,
    strayed,
    strays,
    window_errors,
)
from onlinebayes.criticism.windows import Windows
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

STEPS = 40
ROUNDS = 2  # in which windows' starts settle one by one before a further descent
NOTICED = 0.01  # of the misfit: by what it falls at least where starts had not settled
TOLERANCE = 1e-5  # of the objective: what the last step may promise
SLACK = 1e-3  # and what it may give; kinked effects give more than a linearisation promises
CREEP = 0.05  # of the objective: what a step gains at least where there is hope
DIFFERENCE = 30.0  # sd of a parameter that a finite difference may span
FAR = 0.05  # of the objective: what a step promises where the fit is not to be given up
PARTS = (0.0, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7)
DAMPINGS = (1e-3, 1e-2, 1e-1, 0.3, 1.0, 3.0, 1e1, 1e2)


@dataclass(frozen=True)
class Fit:
    """A simulator fitted to windows.

    Args:
        simulator: with the effects it was fitted with.
        lin: the linearisation at the mode, whose ``theta`` it is.
        projected: the same with starts projected out, at the long horizon.
        converged: whether no step was left that lowers the objective noticeably.
    """

    simulator: Simulator
    lin: Linearisation
    projected: Projected
    converged: bool

    @property
    def theta(self) -> Float[Tensor, " P"]:
        """The mode [SI]."""
        return self.lin.theta


def fit(
    simulator: Simulator,
    windows: Windows,
    theta: Float[Tensor, " P"],
    weight: Float[Tensor, " S"] | None = None,
    starts: Float[Tensor, "W J2"] | None = None,
    hopeless: float = math.inf,
) -> Fit:
    """Fit theta from a starting value.

    Args:
        simulator: what is fitted; its parameters' bounds are the prior.
        windows: the fit windows.
        theta: where to begin [SI].
        weight: of each signal relative to its noise.
        starts: where the windows' starts begin; the smoothed ones when None.
        hopeless: an objective above which a fit that creeps is given up, not converged.

    Raises:
        BadInput: the replay diverges at the starting value.
    """
    return improve(unfitted(simulator, windows, theta, weight, starts), windows, hopeless)


def unfitted(
    simulator: Simulator,
    windows: Windows,
    theta: Float[Tensor, " P"],
    weight: Float[Tensor, " S"] | None = None,
    starts: Float[Tensor, "W J2"] | None = None,
) -> Fit:
    """Where a fit begins; arguments and errors as :func:`fit`."""
    theta = simulator.parameters.clamp(theta)
    if starts is None:
        starts = windows.start
    else:
        weights = row_weights(windows, torch.ones_like(windows.noise) if weight is None else weight)
        starts, _ = best_starts(simulator, windows, weights, theta, torch.stack([starts, windows.start]))
    lin = linearise(simulator, windows, theta, starts)
    if not lin.valid:
        raise BadInput(
            "the simulation diverges over the measured windows",
            "check the model, its time step and the bounds of its parameters, or shorten horizon_s",
        )
    return Fit(simulator, lin, project(windows, lin, weight), False)


def improve(begun: Fit, windows: Windows, hopeless: float = math.inf) -> Fit:
    """Descend, let the starts of windows that stand out settle, and descend again where that changed much."""
    found = descend(begun, windows, hopeless)
    if not found.converged and found.projected.objective <= hopeless:
        # It crept on to the last step: starts that made up for a wrong theta hold it back, and are let go.
        begun = unfitted(found.simulator, windows, found.theta, found.projected.weight)
        found = min(found, descend(begun, windows, hopeless), key=lambda one: one.projected.objective)
    for _ in range(ROUNDS):
        if not found.converged:
            break
        starts, before, after = settled_starts(found.simulator, windows, found.lin, found.projected)
        if after > (1 - NOTICED) * before:
            break
        lin = linearise(found.simulator, windows, found.theta, starts, difference_steps(found.projected))
        if not lin.valid:
            break
        found = Fit(found.simulator, lin, project(windows, lin, found.projected.weight), True)
        further = descend(found, windows, hopeless)
        # What a linearisation promises counts for little in windows such as these: what the replay gives decides.
        if float(misfits(windows, further.lin, further.projected.row_weight).sum()) > after:
            break
        found = further
    return found


def descend(begun: Fit, windows: Windows, hopeless: float) -> Fit:
    """Steps of theta and all starts until none lowers the objective noticeably."""
    simulator, lin, current = begun.simulator, begun.lin, begun.projected
    centred, searching = False, False
    for _ in range(STEPS):
        total = current.objective
        step, promised = bounded_step(simulator, current, lin.theta, 0.0)
        damped = False
        if searching:
            step, damped = best_damped(simulator, windows, lin, current)
        there = step_to(simulator, windows, lin, current, step, chord=promised <= TOLERANCE * total)
        if there is not None and there[1].objective <= total:
            moved, trial = there
            gained, centred = total - trial.objective, True
            lin, current = moved, trial
            if gained <= SLACK * total and (searching or promised <= TOLERANCE * total):
                return Fit(simulator, lin, current, True)
            if gained <= CREEP * total and trial.objective > hopeless:
                return Fit(simulator, lin, current, False)
            searching = damped
        elif promised <= TOLERANCE * total and centred:
            return Fit(simulator, lin, current, True)
        elif searching:
            back = backtracked(simulator, windows, lin, current) if promised > FAR * total else None
            if back is None:
                return Fit(simulator, lin, current, True)
            lin, current = back
        elif centred:
            searching = True
        else:
            # The sensitivities hold at the windows' best starts, and the starts are not there yet.
            there = step_to(simulator, windows, lin, current, torch.zeros_like(step))
            if there is None:
                return Fit(simulator, lin, current, True)
            (lin, current), centred = there, True
    return Fit(simulator, lin, current, False)


def best_damped(
    simulator: Simulator, windows: Windows, lin: Linearisation, projected: Projected
) -> tuple[Float[Tensor, " P"], bool]:
    """The best of the undamped and several damped steps, all replayed at once with the starts that go with them.

    Returns:
        The step, and whether it is damped.
    """
    dampings = (0.0, *DAMPINGS)
    steps = torch.stack([bounded_step(simulator, projected, lin.theta, damping)[0] for damping in dampings])
    theta = simulator.parameters.clamp(lin.theta + steps)
    starts = torch.stack([lin.starts + start_shift(windows, lin, projected, step) for step in steps])
    error = window_errors(simulator, windows, projected.row_weight, theta, starts).sum(1)
    best = int(error.argmin())
    return steps[best], best > 0


def backtracked(
    simulator: Simulator, windows: Windows, lin: Linearisation, projected: Projected
) -> tuple[Linearisation, Projected] | None:
    """Theta and all starts moved together by part of the undamped step; None where no part lowers the error.

    A damped step of theta still takes the starts all the way. Far from the truth, where they are to make up for what
    the model lacks, that leads astray; along the joint step a small enough part always descends.
    """
    step, _ = bounded_step(simulator, projected, lin.theta, 0.0)
    shift = start_shift(windows, lin, projected, step)
    part = lin.theta.new_tensor(PARTS)
    theta = simulator.parameters.clamp(lin.theta + part[:, None] * step)
    starts = lin.starts + part[:, None, None] * shift
    error = window_errors(simulator, windows, projected.row_weight, theta, starts).sum(1)
    best = int(error.argmin())
    if best == 0 or not bool(error[best] < (1 - SLACK) * error[0]):
        return None
    moved = linearise(simulator, windows, theta[best], starts[best], difference_steps(projected))
    return (moved, project(windows, moved, projected.weight)) if moved.valid else None


def step_to(
    simulator: Simulator,
    windows: Windows,
    lin: Linearisation,
    current: Projected,
    step: Float[Tensor, " P"],
    chord: bool = False,
) -> tuple[Linearisation, Projected] | None:
    """The linearisation one step away, with its projection; starts that the step led astray are brought back.

    Args:
        simulator, windows: what is fitted.
        lin, current: where the step begins.
        step: of theta [SI].
        chord: keep the derivatives.

    Returns:
        None where a world diverges, or where one replay shows that the step does not descend.
    """
    theta = simulator.parameters.clamp(lin.theta + step)
    starts = lin.starts + start_shift(windows, lin, current, step)
    shown = None
    if bool(step.any()):
        shown = descended(simulator, windows, current, theta, starts)
        if shown is None:
            return None
    if chord and shown is not None:
        moved = replace(lin, theta=theta, starts=starts, residual=windows.bin(windows.value) - shown)
    else:
        moved = linearise(simulator, windows, theta, starts, difference_steps(current), shown)
    trial = project(windows, moved, current.weight)
    stray = strays(current, trial)
    if not moved.valid:
        return None
    if not bool(stray.any()):
        return moved, trial
    candidates = torch.stack([moved.starts, lin.starts, windows.start])
    best, _ = best_starts(simulator, windows, current.row_weight, moved.theta, candidates)
    starts = torch.where(stray[:, None], best, moved.starts)
    if torch.equal(starts, moved.starts):
        return moved, trial
    moved = linearise(simulator, windows, moved.theta, starts, difference_steps(current))
    return (moved, project(windows, moved, current.weight)) if moved.valid else None


def descended(
    simulator: Simulator,
    windows: Windows,
    current: Projected,
    theta: Float[Tensor, " P"],
    starts: Float[Tensor, "W J2"],
) -> Float[Tensor, "W n S"] | None:
    """The binned replay at a new point; None where, projected as at the old one, it errs by more; strays as they were.

    Where a window diverged it is None, too.
    """
    signals, valid = replay(simulator, windows, theta[None], starts[None])
    shown = windows.bin(signals)[0]
    rows = residual_rows(windows, windows.bin(windows.value) - shown, starts)
    now = current.project(rows[..., None])[..., 0].square().sum(1)
    was = current.residual.square().sum(1)
    errs = float(torch.where(strayed(was, now), was, now).sum())
    return shown if bool(valid.all()) and errs <= current.objective else None


def difference_steps(projected: Projected) -> Float[Tensor, " P"]:
    """Longest steps for finite differences [SI]: 30 sd of each parameter, were it alone."""
    rows = (projected.row_weight > 0).sum().clamp_min(1)
    scale = (projected.residual.square().sum() / rows).sqrt()
    return DIFFERENCE * scale / projected.columns.flatten(0, 1).norm(dim=0).clamp_min(1e-300)


def bounded_step(
    simulator: Simulator, projected: Projected, theta: Float[Tensor, " P"], damping: float
) -> tuple[Float[Tensor, " P"], float]:
    """The damped step within the bounds, and by how much it promises to lower the objective."""
    C, r = projected.columns.flatten(0, 1), projected.residual.flatten()
    space = simulator.parameters
    step = bounded_least_squares(C.T @ C, C.T @ r, space.low.to(theta) - theta, space.high.to(theta) - theta, damping)
    promised = float(r.square().sum() - (r - C @ step).square().sum())
    return step, promised
