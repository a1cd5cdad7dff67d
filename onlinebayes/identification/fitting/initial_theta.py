"""The starting point of a first fit: the best of several points within the bounds, with restarts where much is left."""

from __future__ import annotations

import contextlib

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.fit import Fit, fit
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable

DRAWS = 8  # of the box
MUCH = 2.0  # noise: RMS of a fit that may not be the best one


def starting_theta(simulator: Identifiable, windows: Windows) -> Float[Tensor, " P"]:
    """The best of the nominal theta and a few points of the box, by the replay from the smoothed starts."""
    space = simulator.parameters
    nominal = space.clamp(simulator.nominal.to(windows.start))
    if not len(space):
        return nominal
    sobol = torch.quasirandom.SobolEngine(len(space), scramble=True, seed=0).draw(DRAWS).to(nominal)
    tried = torch.cat([nominal[None], space.from_unit(sobol)])
    signals, valid = replay(simulator, windows, tried, windows.start.expand(len(tried), *windows.start.shape))
    wrong = torch.where(windows.seen, windows.bin(windows.value - signals) / windows.bin_noise, 0.0)
    error = torch.where(valid.all(-1), wrong.square().sum((1, 2, 3)), float("inf"))
    return tried[int(error.argmin())]


def from_elsewhere(found: Fit, windows: Windows, begun: Float[Tensor, " P"]) -> Fit:
    """The best of a first fit and, where it leaves much, of others: from nominal theta, from its own with fresh starts.

    Where contacts stick, starts that made up for a wrong theta on the way can hold a descent far from the optimum.

    Args:
        found: the first fit.
        windows: what it was fitted to.
        begun: theta [SI] from which it began, with fresh starts: that is not done twice.
    """
    rows = (found.projected.row_weight > 0).sum().clamp_min(1)
    if found.projected.objective <= MUCH**2 * float(rows):
        return found
    fits, simulator = [found], found.simulator
    for theta in (simulator.parameters.clamp(simulator.nominal.to(found.theta)), found.theta):
        if torch.equal(theta, begun):
            continue
        with contextlib.suppress(BadInput):  # it diverges from there
            fits.append(fit(simulator, windows, theta, found.projected.weight))
    return min(fits, key=lambda one: one.projected.objective)
