"""A fit with every signal weighed by its noise alone: what is left is then compared with that.

The fit itself weighs signals by the share of their error (:mod:`.gauss_newton`); reports, intervals and flat directions
ask how much noise is left. Derivatives are taken anew, by steps of a few standard deviations of each parameter, were it
alone. Those that lead a fit reach further, and bend: a combination that the data leave flat would look known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.noise import correlation_time
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import Fitted
from onlinebayes.identification.fitting.moments import moments_of
from onlinebayes.identification.fitting.projection import Projected, project, replace_columns
from onlinebayes.identification.fitting.sensitivities import Linearisation, central, parameter_steps
from onlinebayes.simulators.identifiable import Identifiable

DIFFERENCE_SD = 3.0
"""Standard deviations of a parameter, were it alone, by which it is moved. A mass, a damping and a gear, of which only
the ratios are known, have a smallest singular value of 7.6 by a thousandth of their ranges and of .7 so; 3 is flat."""


@dataclass(frozen=True)
class Unmeasured:
    """Numbers of the model that no data were asked about.

    Args:
        columns: what a relative change of each does, starts projected out [weighed noise units].
        sd: of that change.
    """

    columns: Float[Tensor, "V m K"]
    sd: Float[Tensor, " K"]


@dataclass(frozen=True)
class Fit:
    """A simulator fitted to windows.

    Args:
        simulator: with the effects it was fitted with.
        lin: the linearisation at the mode, whose ``theta`` it is.
        projected: the same with starts projected out.
        moments: what moments of inertia do that nobody measured, starts projected out; None where there are none.
    """

    simulator: Identifiable
    lin: Linearisation
    projected: Projected
    moments: Unmeasured | None = None

    @property
    def theta(self) -> Float[Tensor, " P"]:
        """The mode [SI]."""
        return self.lin.theta


def weighed_by_noise(fitted: Fitted, windows: Windows) -> Fit:
    """The fit at its mode; ``windows`` are those that it was fitted to."""
    lin, rows = fitted.lin, fitted.rows
    alone = rows.in_noise(rows.columns.movedim(-1, 0)).square().sum((1, 2, 3)).sqrt()
    step = torch.minimum(parameter_steps(fitted.rough, lin.theta).abs(), DIFFERENCE_SD / alone.clamp_min(1e-300))
    by_theta = central(fitted.rough, windows, lin.theta, lin.starts, step)
    lin = lin if by_theta is None else replace(lin, by_theta=by_theta)
    projected, moments = project(windows, lin), moments_of(fitted.rough, windows, lin.theta, lin.starts)
    if moments is None:
        return Fit(fitted.simulator, lin, projected)
    unmeasured = Unmeasured(replace_columns(projected, windows, moments.by_moment).columns, moments.sd)
    return Fit(fitted.simulator, lin, projected, unmeasured)


def residual_correlation_time(windows: Windows, lin: Linearisation) -> float:
    """Correlation time tau of a fit's start-projected residual [s]; see :func:`.data.noise.correlation_time`."""
    long = project(windows, lin)
    return correlation_time(long.measured_rows(long.residual), long.seen(), windows.bin_step)
