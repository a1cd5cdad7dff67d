"""Theta fitted to convergence: Gauss-Newton with Levenberg's damping, bounds as the prior, starts projected out.

    min over theta in bounds of |r~(theta)|^2,     step:  min |r~ - C~ d|^2 + lambda |D d|^2,  low <= theta + d <= high

with D^2 = diag(C~' C~) (Marquardt 1963). The undamped step is tried by linearising at the new point, so that an
accepted one costs a single rollout. Once one is rejected, no damping and all dampings are tried in one rollout before
each step, until none is the best again: where a kink or a curved valley makes one undamped step too long it makes the
next one, too. Where all of these are refused far from the optimum, parts of the step of theta and starts together are
tried. A world that diverges rejects its step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from scipy.optimize import lsq_linear
from torch import Tensor

from onlinebayes.criticism.projection import Projected, project, row_weights, signal_rms, start_shift
from onlinebayes.criticism.replay import replay
from onlinebayes.criticism.sensitivities import Linearisation, linearise
from onlinebayes.criticism.strays import best_starts, settled_starts, strays, window_errors
from onlinebayes.criticism.windows import Windows
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

STEPS = 40
ROUNDS = 3  # of descents, between which windows' starts settle one by one
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
    theta = simulator.parameters.clamp(theta)
    if starts is None:
        starts = windows.start
    else:
        weights = row_weights(windows, torch.ones_like(windows.noise) if weight is None else weight)
        starts = best_starts(simulator, windows, weights, theta, torch.stack([starts, windows.start]))
    lin = linearise(simulator, windows, theta, starts)
    if not lin.valid:
        raise BadInput(
            "the simulation diverges over the measured windows",
            "check the model, its time step and the bounds of its parameters, or shorten horizon_s",
        )
    found = descend(simulator, windows, lin, project(windows, lin, weight), hopeless)
    for _ in range(ROUNDS):
        starts = settled_starts(simulator, windows, found.lin, found.projected) if found.converged else found.lin.starts
        if torch.equal(starts, found.lin.starts):
            break
        lin = linearise(simulator, windows, found.theta, starts, difference_steps(found.projected))
        settled = project(windows, lin, weight)
        if not lin.valid or settled.objective > (1 - SLACK) * found.projected.objective:
            break
        found = descend(simulator, windows, lin, settled, hopeless)
    return found


def descend(
    simulator: Simulator, windows: Windows, lin: Linearisation, current: Projected, hopeless: float = math.inf
) -> Fit:
    """Steps of theta and all starts until none lowers the objective noticeably; arguments as :func:`fit`."""
    centred, searching = False, False
    for _ in range(STEPS):
        total = current.objective
        step, promised = bounded_step(simulator, current, lin.theta, 0.0)
        damped = False
        if searching:
            step, damped = best_damped(simulator, windows, lin, current)
        moved, trial = step_to(simulator, windows, lin, current, step)
        if moved.valid and trial.objective <= total:
            gained, centred = total - trial.objective, True
            lin, current = moved, trial
            if gained <= SLACK * total and (searching or promised <= TOLERANCE * total):
                return Fit(simulator, lin, current, True)
            if gained <= CREEP * total and trial.objective > hopeless:
                return Fit(simulator, lin, current, False)
            searching = damped
        elif searching:
            back = backtracked(simulator, windows, lin, current) if promised > FAR * total else None
            if back is None:
                return Fit(simulator, lin, current, True)
            lin, current = back
        elif centred:
            searching = True
        else:
            # The sensitivities hold at the windows' best starts, and the starts are not there yet.
            moved, trial = step_to(simulator, windows, lin, current, torch.zeros_like(step))
            if not moved.valid:
                return Fit(simulator, lin, current, True)
            lin, current, centred = moved, trial, True
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
    simulator: Simulator, windows: Windows, lin: Linearisation, current: Projected, step: Float[Tensor, " P"]
) -> tuple[Linearisation, Projected]:
    """The linearisation one step away, with its projection; starts that the step led astray are brought back."""
    moved = linearise_at(simulator, windows, lin, current, step)
    trial = project(windows, moved, current.weight)
    stray = strays(current, trial)
    if not moved.valid or not bool(stray.any()):
        return moved, trial
    candidates = torch.stack([moved.starts, lin.starts, windows.start])
    best = best_starts(simulator, windows, current.row_weight, moved.theta, candidates)
    starts = torch.where(stray[:, None], best, moved.starts)
    if torch.equal(starts, moved.starts):
        return moved, trial
    moved = linearise(simulator, windows, moved.theta, starts, difference_steps(current))
    return moved, project(windows, moved, current.weight)


def linearise_at(
    simulator: Simulator, windows: Windows, lin: Linearisation, projected: Projected, step: Float[Tensor, " P"]
) -> Linearisation:
    """The linearisation one step away, the starts moved along."""
    shift = start_shift(windows, lin, projected, step)
    theta = simulator.parameters.clamp(lin.theta + step)
    return linearise(simulator, windows, theta, lin.starts + shift, difference_steps(projected))


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


def bounded_least_squares(
    normal: Float[Tensor, "P P"],
    gradient: Float[Tensor, " P"],
    low: Float[Tensor, " P"],
    high: Float[Tensor, " P"],
    damping: float = 0.0,
) -> Float[Tensor, " P"]:
    """argmin d' N d - 2 g' d within low <= d <= high; directions without information stay where they are.

    Args:
        normal: N = C' C.
        gradient: g = C' r.
        low, high: bounds of d, low <= 0 <= high.
        damping: lambda, relative to N's diagonal.
    """
    if not len(gradient):
        return gradient
    scale = (high - low).clamp_min(1e-300)
    N = normal * scale[:, None] * scale
    # A billionth of the largest entry keeps a flat direction at zero without moving the others.
    diagonal = N.diagonal()
    N = N + torch.diag(damping * diagonal + 1e-9 * diagonal.max().clamp_min(1e-300) + 1e-300)
    g = gradient * scale
    root = torch.linalg.cholesky(N)
    free = torch.cholesky_solve(g[:, None], root)[:, 0]
    lower, upper = low / scale, high / scale
    if bool(((free >= lower) & (free <= upper)).all()):
        return free * scale
    target = torch.linalg.solve_triangular(root, g[:, None], upper=False)[:, 0]
    edge = 1e-12
    found = lsq_linear(
        root.T.cpu().numpy(),
        target.cpu().numpy(),
        (lower.cpu().numpy() - edge, upper.cpu().numpy() + edge),
        method="bvls",
    )
    return torch.as_tensor(np.asarray(found.x)).to(scale).clamp(lower, upper) * scale


def starting_theta(simulator: Simulator, windows: Windows, draws: int = 8) -> Float[Tensor, " P"]:
    """The best of the nominal theta and a few points of the box, by the replay from the smoothed starts."""
    space = simulator.parameters
    nominal = space.clamp(simulator.nominal.to(windows.start))
    if not len(space):
        return nominal
    sobol = torch.quasirandom.SobolEngine(len(space), scramble=True, seed=0).draw(draws).to(nominal)
    tried = torch.cat([nominal[None], space.from_unit(sobol)])
    signals, valid = replay(simulator, windows, tried, windows.start.expand(len(tried), *windows.start.shape))
    wrong = torch.where(windows.seen, windows.bin(windows.value - signals) / windows.bin_noise, 0.0)
    error = torch.where(valid.all(-1), wrong.square().sum((1, 2, 3)), float("inf"))
    return tried[int(error.argmin())]


def refreshed_weight(windows: Windows, fitted: Fit) -> Float[Tensor, " S"]:
    """Each signal's weight for the next fit: noise / max(RMS of the current residual, noise)."""
    return 1 / signal_rms(project(windows, fitted.lin)).clamp_min(1.0)
