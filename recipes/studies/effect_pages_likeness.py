"""Likeness of effects: the angle between what two of them do to the replay, once the rest is projected out.

    c~ = (1 - P) (replay with the effect - replay without) / noise,   P onto the starts and the free parameters' columns
    cos(A, B) = max over the points at which diagnose tries B of  c~_A' c~_B / (|c~_A| |c~_B|)

A at its specimen's values; for B with a size of either sign the absolute value counts. At cos the share
sqrt(1 - cos^2) of A's trace (RMS) is what no size of B imitates. An effect of which the free parameters imitate all but
a thousandth (of the squared trace) is confounded with them, and compared as if they were known.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import Trial, grown_theta, trials
from onlinebayes.identification import Projected, Windows, columns, linearise, noise_rows, project
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.identifiable import Identifiable

CONFOUNDED = 1e-3
"""Share of its square of which nothing but this is left: then the free parameters do the same already."""


@dataclass(frozen=True)
class Trace:
    """Traces of an effect in the replay, in C ways: its specimen, a small step from neutral, its starting values.

    Args:
        raw: off the windows' starts.
        own: off the free parameters' columns as well.
        two_sided: whether the size may have either sign.
    """

    raw: Float[Tensor, "C m"]
    own: Float[Tensor, "C m"]
    two_sided: bool

    @property
    def confounded(self) -> bool:
        """True if the free parameters can do what the effect does, when there is little of it."""
        return bool(_share(self)[1] < CONFOUNDED)


@dataclass(frozen=True)
class Likeness:
    """``effect`` looks like ``other``, with this cosine in [-1, 1]."""

    effect: str
    other: str
    cosine: float


def traces(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    effects: Mapping[str, Effect],
    specimens: Mapping[str, Mapping[str, float]],
) -> dict[str, Trace]:
    """The trace of every effect.

    Args:
        simulator: without them.
        windows: of a recording in which nothing is hidden.
        theta: true parameters [SI].
        effects: by key.
        specimens: key -> values [SI].
    """
    projected = project(windows, linearise(simulator, windows, theta, windows.start))
    columns_ = projected.columns.flatten(0, 1)
    basis = torch.linalg.qr(columns_ / columns_.norm(dim=0))[0]
    return {
        key: _trace(simulator, windows, theta, effect, specimens[key], projected, basis)
        for key, effect in effects.items()
    }


def nearest(key: str, found: Mapping[str, Trace], count: int = 3) -> tuple[Likeness, ...]:
    """The effects that this one looks like most, without those that contain it, which look like it by construction."""
    mine = found[key]
    others = [
        Likeness(key, other, cosine(mine, theirs))
        for other, theirs in found.items()
        if other != key and key.partition("@")[0] not in EFFECTS[other.partition("@")[0]].contains
    ]
    return tuple(sorted(others, key=lambda one: -one.cosine)[:count])


def cosine(mine: Trace, theirs: Trace) -> float:
    """The largest cosine of the specimen with any of the other effect's columns."""
    if mine.confounded:
        a, b = mine.raw[0], theirs.raw
    else:
        # What the free parameters do as well would be compared by its rounding errors.
        a, b = mine.own[0], theirs.own[(_share(theirs) >= CONFOUNDED) & (not theirs.confounded)]
    if not len(b):
        return 0.0
    found = (b @ a) / (b.norm(dim=1) * a.norm()).clamp_min(1e-300)
    return float((found.abs() if theirs.two_sided else found).max())


def _share(trace: Trace) -> Float[Tensor, " C"]:
    return trace.own.square().sum(1) / trace.raw.square().sum(1).clamp_min(1e-300)


def _trace(
    simulator: Identifiable,
    windows: Windows,
    theta: Float[Tensor, " P"],
    effect: Effect,
    specimen: Mapping[str, float],
    projected: Projected,
    basis: Float[Tensor, "m P"],
) -> Trace:
    tried = trials([effect])
    grown = simulator.with_effect(effect)
    points = [Trial(0, dict(specimen), tried[0].two_sided, 0.0), *tried]
    moved = torch.stack([grown_theta(simulator, theta, [effect], point) for point in points])
    neutral = grown_theta(simulator, theta, [effect])
    change, valid = columns(grown, windows, neutral, moved, windows.start)
    rows = noise_rows(windows, (change * valid[:, None, None, None]).movedim(0, -1))
    raw = projected.project(rows).flatten(0, 1).T
    return Trace(raw, raw - (raw @ basis) @ basis.T, tried[0].two_sided)
