"""Fits begun again for effects whose sensitivities are all zero at the mode, such as a limit that is never reached.

A gradient cannot move such an effect: the fit is repeated from each of its starting values, the other parameters where
they are. The best of these fits stands, which is the first one where none is better. So begin effects added by hand, at
their neutral values, and refits whose linear estimate of a limit lies out of reach.
"""

from __future__ import annotations

import torch

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit, fit
from onlinebayes.identification.replaying.scoped import effect_entries, with_effect_values
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect


def restart_inactive_effects(fitted: Fit, windows: Windows) -> Fit:
    """The best fit of the same model, from here and from the starting values of effects that moved nothing."""
    for effect in fitted.simulator.effects:
        if not _sleeps(fitted, effect):
            continue
        tried = [fitted]
        for start in effect.starts:
            theta = with_effect_values(fitted.simulator, fitted.theta, effect, start)
            try:
                tried.append(fit(fitted.simulator, windows, theta, fitted.projected.weight, fitted.lin.starts))
            except BadInput:  # it diverges from there
                continue
        fitted = min(tried, key=lambda one: one.projected.objective)
    return fitted


def _sleeps(fitted: Fit, effect: Effect) -> bool:
    """Whether no parameter of the effect moves a row."""
    columns = [fitted.simulator.parameters.index(entry) for entry in effect_entries(fitted.simulator, effect)]
    return bool(columns) and not bool(torch.any(fitted.projected.columns[..., columns] != 0))
