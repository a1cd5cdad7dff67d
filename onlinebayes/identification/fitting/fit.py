"""A fit with every signal weighed by its noise alone: what is left is then compared with that.

The fit itself weighs signals by the share of their error (:mod:`.gauss_newton`); reports, intervals and flat directions
ask how much noise is left. Derivatives are taken anew, by steps of a few standard deviations of each parameter, were it
alone. Those that lead a fit reach further, and bend: a combination that the data leave flat would look known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.noise import correlation_time
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.gauss_newton import Fitted
from onlinebayes.identification.fitting.projection import Projected, project
from onlinebayes.identification.fitting.sensitivities import Linearisation, linearise
from onlinebayes.simulators.identifiable import Identifiable

DIFFERENCE_SD = 3.0
"""Standard deviations of a parameter, were it alone, by which it is moved. A mass, a damping and a gear, of which only
the ratios are known, have a smallest singular value of 7.6 by a thousandth of their ranges and of .7 so; 3 is flat."""


@dataclass(frozen=True)
class Fit:
    """A simulator fitted to windows.

    Args:
        simulator: with the effects it was fitted with.
        lin: the linearisation at the mode, whose ``theta`` it is.
        projected: the same with starts projected out.
    """

    simulator: Identifiable
    lin: Linearisation
    projected: Projected

    @property
    def theta(self) -> Float[Tensor, " P"]:
        """The mode [SI]."""
        return self.lin.theta


def weighed_by_noise(fitted: Fitted, windows: Windows) -> Fit:
    """The fit at its mode; ``windows`` are those that it was fitted to."""
    lin, rows = fitted.lin, fitted.rows
    alone = rows.in_noise(rows.columns.movedim(-1, 0)).square().sum((1, 2, 3)).sqrt()
    fine = linearise(fitted.rough, windows, lin.theta, lin.starts, DIFFERENCE_SD / alone.clamp_min(1e-300))
    lin = replace(fine, residual=lin.residual) if fine.valid else lin
    return Fit(fitted.simulator, lin, project(windows, lin))


def residual_correlation_time(windows: Windows, lin: Linearisation) -> float:
    """Correlation time tau of a fit's start-projected residual [s]; see :func:`.data.noise.correlation_time`."""
    long = project(windows, lin)
    return correlation_time(long.measured_rows(long.residual), long.seen(), windows.bin_step)
