"""The theta under which trajectories are likeliest, for many sets of them at once.

    z <- z + (H + l diag H)^-1 s        s, H: score and information, summed over the trajectories of a set

(Levenberg 1944, Marquardt 1963) by the likelihood of a ``SimulatorFilter``, first with a disturbed state, then with
less and less of it, each time from where the last climb ended: a needle is found by its slope (graduated
optimisation, Blake and Zisserman 1987). Where the innovations at the peak are larger than noise, it was the wrong
peak, and other starts are tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.embeddings.kalman import Evidence, Rows, SimulatorFilter

Levels = Sequence[tuple[float, int]]
"""Process noise in units of the sensors', and the most steps at it, one climb after the other."""

DISTURBED: Levels = ((1.0, 6), (0.1, 6), (0.0, 12))
"""With the last alone 29 % of Pendulum's modes are missed from the box's centre, with all three 9 %."""

STRAIGHT: Levels = ((0.0, 12),)
"""At once by the likelihood itself, in half the time: for short trajectories of systems that do not diverge."""

UNEXPLAINED = 1.5
"""Mean square of normalised innovations, one at the right peak: fifty steps of three sensors make a tenth of it."""

ENOUGH = 0.01
"""Nats: a climb that promises less has ended."""

FARTHEST = 0.3
"""Of the box: the longest step."""

DAMPING, CHANGE = 1e-3, 10.0
"""l at the start, and its factor after a step that failed (and its inverse after a good one)."""

RIDGE = 1.0
"""Added to the information of z: what says less than a whole box would."""


class Peak(NamedTuple):
    """The top of G likelihoods.

    Attributes:
        z: where, in [0, 1]^P.
        evidence: there, summed over each set; innovations are averaged.
    """

    z: Float[Tensor, "G P"]
    evidence: Evidence


@torch.no_grad()
def likeliest(
    model: SimulatorFilter, rows: Rows, members: int, starts: Float[Tensor, "K P"], levels: Levels = DISTURBED
) -> Peak:
    """The peaks of G sets of ``members`` trajectories.

    Args:
        model: the filter.
        rows: G * members trajectories, those of one set side by side; a masked one says nothing.
        members: of a set.
        starts: z to climb from: the first for all sets, the others where its peak leaves more than noise.
        levels: of process noise.
    """
    G, starts = len(rows.mask) // members, starts.to(rows.first)
    best = climbed(model, rows, members, starts[:1].expand(G, -1), levels)
    left = (best.evidence.innovation.mean(1) > UNEXPLAINED).nonzero()[:, 0]
    others = len(starts) - 1
    if not len(left) or not others:
        return best
    again = left.repeat(others)
    some = Rows(*(part.unflatten(0, (G, members))[again].flatten(0, 1) for part in rows))
    found = climbed(model, some, members, starts[1:].repeat_interleave(len(left), 0), levels)
    height = found.evidence.log_likelihood.unflatten(0, (others, len(left)))
    top, which = height.max(0)
    higher = top > best.evidence.log_likelihood[left]
    pick = (which * len(left) + torch.arange(len(left), device=left.device))[higher]
    for part, new in zip((best.z, *best.evidence), (found.z, *found.evidence), strict=True):
        part[left[higher]] = new[pick]
    return best


def climbed(
    model: SimulatorFilter, rows: Rows, members: int, z: Float[Tensor, "G P"], levels: Levels = DISTURBED
) -> Peak:
    """The peaks above z, one a set. All that still climb are looked at together, each at its own level."""
    sets, z, moving = _Sets(model, rows, members), z.clone(), torch.arange(len(z), device=z.device)
    process = z.new_tensor([disturbance for disturbance, _ in levels])
    steps = torch.tensor([most for _, most in levels], device=z.device)
    level, damping = torch.zeros_like(moving), z.new_full((len(z),), DAMPING)
    left, here = steps[level], sets.at(moving, z, process[level])
    while True:
        there, promised = _proposed(z[moving], Evidence(*(part[moving] for part in here)), damping[moving])
        anew = (promised <= ENOUGH) | (left[moving] == 0)
        level[moving[anew]] += 1
        there, on = torch.where(anew[:, None], z[moving], there), level[moving] < len(levels)
        moving, there, anew = moving[on], there[on], anew[on]
        if not len(moving):
            return Peak(z, here)
        found = sets.at(moving, there, process[level[moving]])
        better = anew | (found.log_likelihood > here.log_likelihood[moving])
        z[moving[better]] = there[better]
        for part, new in zip(here, found, strict=True):
            part[moving[better]] = new[better]
        changed = damping[moving] * torch.where(better, 1 / CHANGE, CHANGE)
        damping[moving] = torch.where(anew, DAMPING, changed)
        left[moving] = torch.where(anew, steps[level[moving]], left[moving] - 1)


class _Sets:
    """The evidence of sets of trajectories."""

    def __init__(self, model: SimulatorFilter, rows: Rows, members: int) -> None:
        self._model, self._members = model, members
        self._rows = [part.unflatten(0, (-1, members)) for part in rows]

    def at(self, index: Tensor, z: Float[Tensor, "N P"], process: Float[Tensor, " N"]) -> Evidence:
        """Of the sets ``index`` (N,), each at its z and with its process noise."""
        some = Rows(*(part[index].flatten(0, 1) for part in self._rows))
        z, process = (values.repeat_interleave(self._members, 0) for values in (z, process))
        each = [part.unflatten(0, (-1, self._members)) for part in self._model(some, z, process)]
        there = some.mask.any(1).unflatten(0, (-1, self._members))[..., None].to(z)
        innovation = (each[3] * there).sum(1) / there.sum(1).clamp_min(1)
        return Evidence(each[0].sum(1), each[1].sum(1), each[2].sum(1), innovation)


def _proposed(z: Tensor, here: Evidence, damping: Tensor) -> tuple[Tensor, Tensor]:
    """Propose a step within the box; return the point where it leads, and the gain that it promises [nats]."""
    H = here.information
    damped = H + torch.diag_embed(damping[:, None] * torch.diagonal(H, dim1=-2, dim2=-1) + RIDGE)
    step = torch.linalg.solve(damped, here.score[..., None])[..., 0].clamp(-FARTHEST, FARTHEST)
    there = (z + step).clamp(0, 1)
    step = there - z
    return there, (here.score * step).sum(-1) - 0.5 * (step[:, None] @ H @ step[..., None])[:, 0, 0]
