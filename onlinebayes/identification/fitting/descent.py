"""Steps of theta and all windows' starts, each of which lowers the misfit: Gauss-Newton with Levenberg's damping.

    step:  min |r~ - C~ d|^2 + lambda |D d|^2,  low <= theta + d <= high,    D^2 = diag(C~' C~)    (Marquardt 1963)

The undamped step is tried first. One replay, projected as before the step, tells whether it can be taken; only then is
the new point linearised, which costs a replay for each parameter and start. The last step, which promises next to
nothing, keeps the derivatives.
Once a step is rejected, no damping and all dampings are replayed at once before each step, until none is the best
again: where a kink or a curved valley makes one undamped step too long it makes the next one, too. Where all of these
are refused far from the optimum, parts of the step of theta and starts together are tried. A world that diverges
rejects its step. Steps that gain next to nothing, several in a row, end it as *crept*: a few windows whose starts no
common step moves hold theta back then, and those are settled at less cost (see :mod:`.fit`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.outlying_starts import (
    best_starts,
    replayed_misfits,
    residual_rows,
    worsened,
    worsened_windows,
)
from onlinebayes.identification.fitting.projection import Projected, project, start_shift
from onlinebayes.identification.fitting.sensitivities import Linearisation, linearise
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.identification.replaying.replay import replay_binned
from onlinebayes.simulators.identifiable import Identifiable

MOST_STEPS = 40
"""A descent ends after so many steps."""

LEAST_PROMISE = 1e-5
"""A step that promises a smaller share of the objective is the last one."""

LEAST_GAIN = 1e-3
"""A last step gains no larger share of the objective; kinked effects give more than a linearisation promises."""

HOPEFUL_GAIN = 0.05
"""Where the objective is hopeless, a step that gains no larger share of it ends the descent."""

CREEPING_GAIN = 0.02
"""A damped step that gains no larger share of the objective creeps."""

PATIENCE = 2
"""A descent ends after so many creeping steps in a row."""

DIFFERENCE_SD = 30.0
"""A finite difference spans so many sd of its parameter at most."""

HOPEFUL_PROMISE = 0.05
"""Where the undamped step promises a larger share of the objective, parts of it are tried before the fit ends."""

STEP_PARTS = (0.0, 0.01, 0.03, 0.1, 0.2, 0.4, 0.7)
"""Parts of the undamped step of theta and starts that are tried together; none first."""

DAMPINGS = (1e-3, 1e-2, 1e-1, 0.3, 1.0, 3.0, 1e1, 1e2)
"""Levenberg's lambdas that are tried beside no damping."""


@dataclass(frozen=True)
class Descent:
    """Where a descent ended, and why: no step lowers the misfit, steps crept, hopeless, or out of steps."""

    lin: Linearisation
    projected: Projected
    ended: Literal["converged", "crept", "given up"]


def descend(
    simulator: Identifiable,
    windows: Windows,
    lin: Linearisation,
    current: Projected,
    hopeless: float = math.inf,
    patience: int = PATIENCE,
) -> Descent:
    """Steps of theta and all starts until none lowers the objective noticeably.

    Args:
        simulator, windows: what is fitted.
        lin, current: where it begins.
        hopeless: an objective above which a descent that creeps is given up.
        patience: damped steps in a row that may gain little.
    """
    centred, searching, slow = False, False, 0
    for _ in range(MOST_STEPS):
        total = current.objective
        step, promised = bounded_step(simulator, current, lin.theta, 0.0)
        damped = False
        if searching:
            step, damped = best_damped(simulator, windows, lin, current)
        there = step_to(simulator, windows, lin, current, step, chord=promised <= LEAST_PROMISE * total)
        if there is not None and there[1].objective <= total:
            moved, trial = there
            gained, centred = total - trial.objective, True
            lin, current = moved, trial
            if gained <= LEAST_GAIN * total and (searching or promised <= LEAST_PROMISE * total):
                return Descent(lin, current, "converged")
            if gained <= HOPEFUL_GAIN * total and trial.objective > hopeless:
                return Descent(lin, current, "given up")
            slow = slow + 1 if damped and gained <= CREEPING_GAIN * total else 0
            if slow >= patience:
                return Descent(lin, current, "crept")
            searching = damped
        elif promised <= LEAST_PROMISE * total and centred:
            return Descent(lin, current, "converged")
        elif searching:
            back = backtracked(simulator, windows, lin, current) if promised > HOPEFUL_PROMISE * total else None
            if back is None:
                return Descent(lin, current, "converged")
            lin, current = back
        elif centred:
            searching = True
        else:
            # The sensitivities hold at the windows' best starts, and the starts are not there yet.
            there = step_to(simulator, windows, lin, current, torch.zeros_like(step))
            if there is None:
                return Descent(lin, current, "converged")
            (lin, current), centred = there, True
    return Descent(lin, current, "given up")


def best_damped(
    simulator: Identifiable, windows: Windows, lin: Linearisation, projected: Projected
) -> tuple[Float[Tensor, " P"], bool]:
    """The best of the undamped and several damped steps, all replayed at once with the starts that go with them.

    Returns:
        The step, and whether it is damped.
    """
    dampings = (0.0, *DAMPINGS)
    steps = torch.stack([bounded_step(simulator, projected, lin.theta, damping)[0] for damping in dampings])
    theta = simulator.parameters.clamp(lin.theta + steps)
    starts = torch.stack([lin.starts + start_shift(windows, lin, projected, step) for step in steps])
    error = replayed_misfits(simulator, windows, projected.row_weight, theta, starts).sum(1)
    best = int(error.argmin())
    return steps[best], best > 0


def backtracked(
    simulator: Identifiable, windows: Windows, lin: Linearisation, projected: Projected
) -> tuple[Linearisation, Projected] | None:
    """Theta and all starts moved together by part of the undamped step; None where no part lowers the error.

    A damped step of theta still takes the starts all the way. Far from the truth, where they are to make up for what
    the model lacks, that leads astray; along the joint step a small enough part always descends.
    """
    step, _ = bounded_step(simulator, projected, lin.theta, 0.0)
    shift = start_shift(windows, lin, projected, step)
    part = lin.theta.new_tensor(STEP_PARTS)
    theta = simulator.parameters.clamp(lin.theta + part[:, None] * step)
    starts = lin.starts + part[:, None, None] * shift
    error = replayed_misfits(simulator, windows, projected.row_weight, theta, starts).sum(1)
    best = int(error.argmin())
    if best == 0 or not bool(error[best] < (1 - LEAST_GAIN) * error[0]):
        return None
    moved = linearise(simulator, windows, theta[best], starts[best], difference_steps(projected))
    return (moved, project(windows, moved, projected.weight)) if moved.valid else None


def step_to(
    simulator: Identifiable,
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
    if not moved.valid:
        return None
    stray = torch.nonzero(worsened_windows(current, trial))[:, 0]
    if not len(stray):
        return moved, trial
    candidates = torch.stack([moved.starts, lin.starts, windows.start])[:, stray]
    part, weight = windows.select(stray), current.row_weight[stray]
    starts = moved.starts.index_copy(0, stray, best_starts(simulator, part, weight, moved.theta, candidates)[0])
    if torch.equal(starts, moved.starts):
        return moved, trial
    moved = linearise(simulator, windows, moved.theta, starts, difference_steps(current))
    return (moved, project(windows, moved, current.weight)) if moved.valid else None


def descended(
    simulator: Identifiable,
    windows: Windows,
    current: Projected,
    theta: Float[Tensor, " P"],
    starts: Float[Tensor, "W J2"],
) -> Float[Tensor, "W n S"] | None:
    """The binned replay at a new point; None where, projected as at the old one, it errs by more; strays as they were.

    Where a window diverged it is None, too.
    """
    binned, valid = replay_binned(simulator, windows, theta[None], starts[None])
    shown = binned[0]
    rows = residual_rows(windows, windows.bin(windows.value) - shown, starts)
    now = current.project(rows[..., None])[..., 0].square().sum(1)
    was = current.residual.square().sum(1)
    errs = float(torch.where(worsened(was, now), was, now).sum())
    return shown if bool(valid.all()) and errs <= current.objective else None


def difference_steps(projected: Projected) -> Float[Tensor, " P"]:
    """Longest steps for finite differences [SI]: 30 sd of each parameter, were it alone."""
    rows = (projected.row_weight > 0).sum().clamp_min(1)
    scale = (projected.residual.square().sum() / rows).sqrt()
    return DIFFERENCE_SD * scale / projected.columns.flatten(0, 1).norm(dim=0).clamp_min(1e-300)


def bounded_step(
    simulator: Identifiable, projected: Projected, theta: Float[Tensor, " P"], damping: float
) -> tuple[Float[Tensor, " P"], float]:
    """The damped step within the bounds, and by how much it promises to lower the objective."""
    C, r = projected.columns.flatten(0, 1), projected.residual.flatten()
    space = simulator.parameters
    step = bounded_least_squares(C.T @ C, C.T @ r, space.low.to(theta) - theta, space.high.to(theta) - theta, damping)
    promised = float(r.square().sum() - (r - C @ step).square().sum())
    return step, promised
