"""The parameters with one value in every unit: how far the units differ, and what the next unit's value may be.

Each parameter stands alone: that two numbers of one unit go together is not used. A unit whose value the data do not
determine has no part in it. Intervals are cut at the bounds.
"""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.identification.fleet import Fleet, fleet_of
from onlinebayes.identification.results import Estimate, FittedModel
from onlinebayes.identification.scope import address_of, unit_of
from onlinebayes.parameters import Parameter


def fleets_of(model: FittedModel) -> dict[str, Fleet]:
    """Address -> fleet, of each parameter whose value the data determine in two units or more.

    Args:
        model: as fitted, with its covariance.
    """
    entries: dict[str, dict[str, int]] = {}
    for i, name in enumerate(model.simulator.parameters):
        if unit := unit_of(name):
            entries.setdefault(address_of(name), {})[unit] = i
    found = {}
    for address, places in entries.items():
        known = {unit: i for unit, i in places.items() if _determined(model, i)}
        if len(known) < 2:
            continue
        at = list(known.values())
        left_out = tuple(unit for unit in places if unit not in known)
        bounds = model.simulator.parameters[model.simulator.parameters.names[at[0]]]
        whole = fleet_of(tuple(known), model.theta[at], model.covariance[at][:, at], bounds.unit, left_out)
        found[address] = replace(
            whole,
            mean=_cut(whole.mean, bounds),
            units={unit: _cut(value, bounds) for unit, value in whole.units.items()},
            next=_cut(whole.next, bounds),
        )
    return found


def _cut(value: Estimate, bounds: Parameter) -> Estimate:
    mean, low, high = (min(max(x, bounds.low), bounds.high) for x in (value.mean, value.q05, value.q95))
    return replace(value, mean=mean, q05=low, q95=high)


def _determined(model: FittedModel, i: int) -> bool:
    value = model.parameters[model.simulator.parameters.names[i]]
    return value.identifiable and bool(0 < float(model.covariance[i, i]) < float("inf"))
