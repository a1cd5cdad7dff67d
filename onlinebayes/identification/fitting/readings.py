"""A log that can be read, or a model tied, in two ways: does the model follow the log far better the other way?"""

from __future__ import annotations

from onlinebayes.identification.data.windows import MEMORY, make_windows
from onlinebayes.identification.fitting.as_run import NOISE_FLOORS, far_better
from onlinebayes.identification.fitting.fit import improve, unfitted
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable


def follows_far_better(final: Grounds, other: Measurement, tied: Identifiable | None = None) -> bool:
    """Whether a model that leaves more than noise follows the log far better as ``other`` reads it.

    Args:
        final: the model with all that was found.
        other: the fit runs, read otherwise than they were for it.
        tied: the same model with constraints that are soft in place of rigid, or rigid in place of soft.
    """
    left = misfit(final.fitted.projected)
    if left <= NOISE_FLOORS:
        return False
    model = final.fitted.simulator if tied is None else final.rung.of(tied)
    horizon, noise = final.windows.horizon, final.windows.noise
    try:
        windows = make_windows(model, other, horizon, MEMORY * horizon, noise)
        fitted = improve(unfitted(model, windows, final.fitted.theta), windows)
    except BadInput:  # no window is left between the gaps, or it diverges
        return False
    return misfit(fitted.projected) <= far_better(left)
