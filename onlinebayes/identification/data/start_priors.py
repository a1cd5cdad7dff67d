"""Priors of the windows' starts: the smoothed state, or what the user knows of how runs begin.

    as measured   s ~ N(smoothed, (20 sd)^2)     sd propagated from the smoother
    known         s ~ N(value, sd^2) where a run begins, N(smoothed, sd^2) in every window: see ``KnownStart``

What is known exactly (sd 0) stays where it is. A prior that was given counts for what it says, however far the model is
off; the smoother's is loosened with the model's error, as all else that is left is put down to the model.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.coordinates import renamed, rotations, velocity
from onlinebayes.measurements import KnownStart
from onlinebayes.runs import BadInput, nearest

START_LOOSENESS = 20.0
"""Times the smoother's sd within which a start may lie: a local cubic errs by more than noise where a motion jerks."""


@dataclass(frozen=True)
class StartPriors:
    """W windows' starts, (q0 of the J joints, v0 of the J joints).

    Args:
        mean: the most likely start [SI].
        sd: of the prior [SI]; 0 where the start is known exactly.
        uncertainty: sd of the mean itself [SI].
        given: where the prior is the user's.
    """

    mean: Float[Tensor, "W J2"]
    sd: Float[Tensor, "W J2"]
    uncertainty: Float[Tensor, "W J2"]
    given: Bool[Tensor, "W J2"]


def start_priors(
    smoothed: Float[Tensor, "W J2"],
    sd: Float[Tensor, "W J2"],
    first: Bool[Tensor, " W"],
    coordinates: Sequence[str],
    known: Mapping[str, KnownStart],
) -> StartPriors:
    """The priors of all starts.

    Args:
        smoothed, sd: as the smoother has them [SI].
        first: whether a window begins where its run does.
        coordinates: names of the J positions, then of the J velocities.
        known: coordinate -> what is known of it.

    Raises:
        BadInput: a coordinate that the model does not have.
    """
    mean, prior, uncertainty = smoothed.clone(), START_LOOSENESS * sd, sd.clone()
    given = torch.zeros_like(mean, dtype=torch.bool)
    for name, one in known.items():
        if name not in coordinates:
            raise BadInput(f"the model has no coordinate '{name}'", nearest(name, coordinates, listed=12))
        k = coordinates.index(name)
        where = first if one.value is not None else torch.ones_like(first)
        given[where, k], prior[where, k] = True, one.sd
        if one.value is not None:
            mean[where, k], uncertainty[where, k] = one.value, one.sd
    return StartPriors(mean, prior, uncertainty, given)


def start_coordinates(signals: Sequence[str]) -> tuple[str, ...]:
    """The coordinates of a start: positions, then velocities; of a free or ball joint three turns, and their rates."""
    charted = renamed(signals, rotations(signals))
    joints = [name.removeprefix("qpos.") for name in charted if name.startswith("qpos.")]
    return coordinates_of(joints, charted)


def coordinates_of(joints: Sequence[str], signals: Sequence[str]) -> tuple[str, ...]:
    """The positions of joint coordinates, then their velocities."""
    rates = [velocity(joint, signals) or f"qvel.{joint}" for joint in joints]
    return (*(f"qpos.{joint}" for joint in joints), *rates)
