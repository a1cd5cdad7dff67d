"""The prior of the next unit of a machine: what the units that were measured say of one that was not.

    theta ~ sum_k w_k N(mean_k, covariance_k),     cut off at the bounds

A parameter with one value a unit is drawn from its fleet (:mod:`onlinebayes.identification.fleet`), whose mixture has a
Student's tails; its correlations with the others are left out. The other parameters are as fitted.

    prior = next_unit(refine(...))                        # or saving.load("out/next_unit.json")
    problem = Problem(simulator, task, prior=prior)       # a simulator of the same parameters
"""

from __future__ import annotations

import torch

from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.mixture import density, embedded
from onlinebayes.identification.replaying.scoped import unscoped
from onlinebayes.inference import TruncatedMixture
from onlinebayes.runs import BadInput


def next_unit(result: Criticism) -> TruncatedMixture:
    """The distribution of the final model's parameters in the next unit, over their bounds.

    Raises:
        BadInput: nothing has one value a unit, or fewer than two units' values are known.
    """
    if not result.fleet:
        raise BadInput(
            "no parameter's spread between units is known",
            'give one the scope "per_unit", in a log of two units or more that determines it',
        )
    space = unscoped(result.final.simulator).parameters
    mean, covariance = embedded(unscoped(result.final.simulator), result.final)
    count = len(next(iter(result.fleet.values())).components)
    weight, means, covariances = mean.new_zeros(count), mean.repeat(count, 1), covariance.repeat(count, 1, 1)
    for address, fleet in result.fleet.items():
        i = space.index(address)
        weight, centre, sd = torch.tensor(fleet.components, dtype=torch.float64).T
        means[:, i] = centre
        covariances[:, i, i] = sd.square()
    return density(space, weight, means, covariances)
