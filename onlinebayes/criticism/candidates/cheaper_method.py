"""Candidates screened by a cheaper method of integration, where that shows the same sensitivities.

    C~ by a method of first order  ~  C~ by Runge and Kutta's:    |C~_1 - C~_4| <= 0.06 |C~_4|, column by column

Screening is linear, and of six joints and 170 candidates it takes most of the time. What it needs of a replay is how it
moves with each candidate, to some per cent; a replay by a method of first order costs a quarter. Its own error, a shift
by half a step, is in the replay of the current model and of every candidate alike, and drops out of their difference.
The columns of the fitted parameters and of the starts are taken by the same method, so that what is confounded with
them stays so; the residual is that of the fit. Where these columns come out otherwise (contacts that stick, a stiff
servo at a long step), nothing is saved and nothing lost but these few replays.
"""

from __future__ import annotations

from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.descent import difference_steps
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.fitting.projection import project
from onlinebayes.identification.fitting.sensitivities import linearise

WORTH = 2  # trials to each column of the current model: fewer do not pay for these
ALIKE = 0.06  # of a column: what the two methods may differ by


def by_cheaper_method(current: Fit, windows: Windows, trials: int) -> Fit:
    """The current model as it is screened: integrated by a cheaper method, or as it stands.

    Args:
        current: the fit.
        windows: what it was fitted on.
        trials: replays that screening takes.
    """
    own = 1 + len(current.theta) + windows.start.shape[1]
    simulator = current.simulator.with_first_order()
    if simulator is current.simulator or trials < WORTH * own:
        return current
    lin = linearise(simulator, windows, current.theta, current.lin.starts, difference_steps(current.projected))
    if not lin.valid:
        return current
    lin = replace(lin, residual=current.lin.residual)
    projected = project(windows, lin, current.projected.weight)
    if not alike(current.projected.columns, projected.columns):
        return current
    return Fit(simulator, lin, projected, current.converged)


def alike(exact: Float[Tensor, "V m P"], cheap: Float[Tensor, "V m P"]) -> bool:
    """Whether every column, starts projected out, is the same to some per cent."""
    differ = (cheap - exact).flatten(0, 1).norm(dim=0)
    return bool((differ <= ALIKE * exact.flatten(0, 1).norm(dim=0)).all())
