"""Theta fitted to convergence, starts projected out, bounds as the prior.

    min over theta in bounds of |r~(theta)|^2

by steps of theta and all windows' starts together (:mod:`.descent`); starts that no common step moves settle one by one
in between (:mod:`.outlying_starts`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.noise import correlation_time
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.descent import MOST_STEPS, PATIENCE, descend, difference_steps
from onlinebayes.identification.fitting.outlying_starts import best_starts, misfits, refit_outlying_starts
from onlinebayes.identification.fitting.projection import Projected, project, row_weights
from onlinebayes.identification.fitting.sensitivities import Linearisation, linearise
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable

ROUNDS = 2  # in which windows' starts settle one by one before a further descent
NOTICED = 0.01  # of the misfit: by what it falls at least where starts had not settled


@dataclass(frozen=True)
class Fit:
    """A simulator fitted to windows.

    Args:
        simulator: with the effects it was fitted with.
        lin: the linearisation at the mode, whose ``theta`` it is.
        projected: the same with starts projected out, at the long horizon.
        converged: whether no step was left that lowers the objective noticeably.
    """

    simulator: Identifiable
    lin: Linearisation
    projected: Projected
    converged: bool

    @property
    def theta(self) -> Float[Tensor, " P"]:
        """The mode [SI]."""
        return self.lin.theta


def fit(
    simulator: Identifiable,
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
    simulator: Identifiable,
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
    """Descend, let the starts of windows that stand out settle, and descend again where that changed much.

    A descent that crept though all starts had settled goes on to its end.
    """
    found, crept = _descended(begun, windows, hopeless)
    if not found.converged and found.projected.objective <= hopeless:
        # It crept on to the last step: starts that made up for a wrong theta hold it back, and are let go.
        begun = unfitted(found.simulator, windows, found.theta, found.projected.weight)
        again, also = _descended(begun, windows, hopeless)
        if again.projected.objective < found.projected.objective:
            found, crept = again, also
    for _ in range(ROUNDS):
        if not found.converged:
            break
        starts, before, after = refit_outlying_starts(found.simulator, windows, found.lin, found.projected)
        if after > (1 - NOTICED) * before:
            break
        lin = linearise(found.simulator, windows, found.theta, starts, difference_steps(found.projected))
        if not lin.valid:
            break
        found = Fit(found.simulator, lin, project(windows, lin, found.projected.weight), True)
        further, also = _descended(found, windows, hopeless)
        # What a linearisation promises counts for little in windows such as these: what the replay gives decides.
        if float(misfits(windows, further.lin, further.projected.row_weight).sum()) > after:
            break
        found, crept = further, also
    return _descended(found, windows, hopeless, patience=MOST_STEPS)[0] if crept and found.converged else found


def residual_correlation_time(windows: Windows, lin: Linearisation) -> float:
    """Correlation time tau of a fit's start-projected residual [s]; see :func:`.data.noise.correlation_time`."""
    long = project(windows, lin)
    return correlation_time(long.measured_rows(long.residual), long.seen(), windows.bin_step)


def _descended(begun: Fit, windows: Windows, hopeless: float, patience: int = PATIENCE) -> tuple[Fit, bool]:
    """The fit at the end of a descent, and whether that ended because it crept."""
    end = descend(begun.simulator, windows, begun.lin, begun.projected, hopeless, patience)
    return Fit(begun.simulator, end.lin, end.projected, end.ended != "given up"), end.ended == "crept"
