"""A log that can be read in two ways: does the fitted model follow it far better in the other one?"""

from __future__ import annotations

from onlinebayes.criticism.data.windows import MEMORY, make_windows
from onlinebayes.criticism.fitting.as_run import NOISE_FLOORS, far_better
from onlinebayes.criticism.fitting.fit import improve, unfitted
from onlinebayes.criticism.fitting.numerics import Grounds
from onlinebayes.criticism.fitting.projection import misfit
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput


def follows_far_better(final: Grounds, other: Measurement) -> bool:
    """Whether a model that leaves more than noise follows the log far better as ``other`` reads it.

    Args:
        final: the model with all that was found.
        other: the fit runs, read otherwise than they were for it.
    """
    left = misfit(final.fitted.projected)
    if left <= NOISE_FLOORS:
        return False
    model, horizon, noise = final.fitted.simulator, final.windows.horizon, final.windows.noise
    try:
        windows = make_windows(model, other, horizon, MEMORY * horizon, noise)
        fitted = improve(unfitted(model, windows, final.fitted.theta), windows)
    except BadInput:  # no window is left between the gaps, or it diverges
        return False
    return misfit(fitted.projected) <= far_better(left)
