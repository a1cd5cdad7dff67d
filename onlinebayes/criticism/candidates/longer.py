"""A dead time or a lag that ends on the bound that criticism chose for it is given a longer one.

Time effects are tried up to a tenth of the horizon (``scales.DEAD_TIME``), for what they remember, and the cost of it,
grows with their bound. Where a fit ends there the data ask for more, and what is missing would be called by other
names. The bound is then three tenths of the horizon, then nine tenths. A user's own bounds stand.
"""

from __future__ import annotations

import dataclasses

from onlinebayes.criticism.candidates.scales import DEAD_TIME
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.simulators.effects import Effect

LONGER = (0.3, 0.9)
"""Of the horizon: what follows the bound by which a time effect is tried at first."""
NEAR = 0.02  # of the bound: a fit this close to it has ended on it


def longer(effect: Effect, fitted: Fit, windows: Windows) -> Effect | None:
    """The same time effect with the next longer bound; None where its fit does not ask for that.

    Args:
        effect: the one whose size is looked at.
        fitted: a model with it.
        windows: what was fitted.
    """
    name = effect.magnitude
    bound = effect.parameters[name]
    parts = (DEAD_TIME, *LONGER)
    tried = next((k for k, part in enumerate(parts) if bound.high == part * windows.horizon), len(parts))
    if bound.unit != "s" or tried + 1 >= len(parts):
        return None
    places = fitted.simulator.parameters.index
    entries = effect_entries(fitted.simulator, effect)
    values = [float(fitted.theta[places(entry)]) for entry, short in entries.items() if short == name]
    if max(values, default=0.0) < (1 - NEAR) * bound.high:
        return None
    wider = dataclasses.replace(bound, high=parts[tried + 1] * windows.horizon)
    return dataclasses.replace(effect, **{name: wider})  # type: ignore[type-var]
