"""Moments of inertia that nobody measured: what is known of theta rests on them as far as the data cannot tell them.

    r ~ r~ - C~ d - N~ e,     e ~ N(0, sd^2),       e: relative change of a body's moments, N~ its column

Where a body's mass is free, its moments are no better known than its mass: sd is half of the mass's range, as a share
of the model's own. All masses, moments, frictions and gears times one factor move alike, so that with a gear free
nothing but the model's moments says how large each of them is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import per_noise
from onlinebayes.identification.fitting.sensitivities import between
from onlinebayes.identification.fitting.theta import theta_of, values_of
from onlinebayes.identification.scope import address_of
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.identifiable import Identifiable

MASS = ".mass"

STEP = 1e-3
"""Relative change of the moments by which their column is looked at first."""

DIFFERENCE_SD = 3.0
"""Sensor noise by which the replay moves, all rows together, where the column is taken: as of parameters."""


@dataclass(frozen=True)
class Moments:
    """The sensitivities of the replay to the moments of inertia of K bodies.

    Args:
        by_moment: d simulated / d e.
        sd: of e.
    """

    by_moment: Float[Tensor, "W n S K"]
    sd: Float[Tensor, " K"]


def moments_of(
    simulator: Identifiable, windows: Windows, theta: Float[Tensor, " P"], starts: Float[Tensor, "W J2"]
) -> Moments | None:
    """The moments of the bodies whose mass is free and whose moments are not; None where there are none.

    Args:
        simulator: what was fitted, as derivatives are taken.
        windows: the data.
        theta, starts: of the fit [SI].
    """
    bodies = _bodies(simulator)
    if not bodies:
        return None
    try:
        free, own = simulator, simulator.own_numbers
        for address in (one for moments in bodies.values() for one in moments):
            free = free.with_free(address, own[address])
        found = _columns(free, windows, theta_of(free, values_of(simulator, theta)), starts, bodies)
    except Stopped:
        raise
    except BadInput:
        return None
    return None if found is None else Moments(found, _half_ranges(simulator, bodies).to(theta))


def _bodies(simulator: Identifiable) -> dict[str, tuple[str, ...]]:
    """Mass that is free -> addresses of its body's moments, where none of these is free or follows the mass."""
    if simulator.with_scaled_moments() is simulator:  # nothing turns, or the moments follow already
        return {}
    names, own = [address_of(name) for name in simulator.parameters], simulator.own_numbers
    found: dict[str, tuple[str, ...]] = {}
    for name in dict.fromkeys(names):
        if name.startswith("body.") and name.endswith(MASS):
            moments = tuple(f"{name.removesuffix(MASS)}.inertia[{k}]" for k in range(3))
            if all(one in own for one in moments):
                found[name] = moments
    return found


def _columns(
    free: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " Q"],
    starts: Float[Tensor, "W J2"],
    bodies: Mapping[str, tuple[str, ...]],
) -> Float[Tensor, "W n S K"] | None:
    """By central differences, small ones first, then such that the replay moves by little more than noise."""
    unit = torch.zeros(len(bodies), len(theta)).to(theta)
    for k, moments in enumerate(bodies.values()):
        for place in (free.parameters.index(one) for one in moments):
            unit[k, place] = theta[place]
    step = torch.full((len(bodies), 1), STEP).to(theta)
    for _ in range(2):
        moved = between(free, windows, theta - step / 2 * unit, theta + step / 2 * unit, starts)
        if moved is None:
            return None
        found = moved / step[:, :, None, None]
        size = (found * per_noise(windows)).square().sum((1, 2, 3)).sqrt().clamp_min(1e-300)
        step = (DIFFERENCE_SD / size).clamp(1e-6, STEP)[:, None]
    return found.movedim(0, -1)


def _half_ranges(simulator: Simulator, bodies: Iterable[str]) -> Float[Tensor, " K"]:
    """Half of the range of each mass, as a share of the model's own."""
    places = [[address_of(name) for name in simulator.parameters].index(mass) for mass in bodies]
    space, own = simulator.parameters, simulator.nominal
    return (space.high - space.low)[places].to(own) / (2 * own[places].abs().clamp_min(1e-300))
