"""Has a machine changed? New windows against the scatter of the reference, one change at a time.

    d_b = u_b / J_b                                       the change that a part of the data asks for, alone
    s^2 = sum_w (u_w - d J_w)^2 / J                       scatter from window to window, model errors included
    v = max(s_parts^2 - s^2, 0) / (J / B)                 more of it from part to part (DerSimonian and Laird 1986)
    t_k = (d_k - d_ref) / sqrt(s^2 / J_k + v / R_k + (s^2 / J + v / B) + leak)          over the new stretches from k on
    p   = C w_k P(|t| > |t_k|),   Student's t with B - 1 degrees of freedom          C changes, K stretches (Bonferroni)

w_k is 2 for the first stretch, which a change before these logs asks for, else 2 (K - 1). R_k is the number of runs
from there on.
A score is compared with how it scatters over the B parts of the reference, so that a model that errs, or a machine that
differs from run to run, does not ring. ``leak`` is the part of an error of the fitted parameters that shows in the new
logs and not in the reference, because these move otherwise: (g_k - g_ref)' Cov (g_k - g_ref), g = J_i. / J_ii.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from scipy.stats import t as student
from torch import Tensor

from onlinebayes.criticism.checking.held import Scores

LEAST = 1e-6
"""Of the mean information of a part: parts with less say nothing of a change."""

FEWEST_PARTS = 3
"""Of the reference, for a scatter."""

INTERVAL = 0.9
"""Of the intervals."""


@dataclass(frozen=True, eq=False)
class Reference:
    """The reference along C changes.

    Args:
        mean: d_ref, the change that it asks for itself.
        J: its information.
        variance: s^2.
        spread: v.
        parts: B of each.
        others: g_ref, by the F fitted parameters.
        covariance: of the fitted parameters.
    """

    mean: Float[Tensor, " C"]
    J: Float[Tensor, " C"]
    variance: Float[Tensor, " C"]
    spread: Float[Tensor, " C"]
    parts: Float[Tensor, " C"]
    others: Float[Tensor, "C F"]
    covariance: Float[Tensor, "F F"]

    @classmethod
    def of(cls, scores: Scores, part: Int[Tensor, " W"], covariance: Float[Tensor, "F F"]) -> Reference:
        """From windows in parts; the fitted parameters are the first F of the changes."""
        J = scores.J.diagonal(dim1=1, dim2=2)
        total = J.sum(0).clamp_min(1e-300)
        mean = scores.u.sum(0) / total
        off = scores.u - mean * J
        of_parts, J_parts = _summed(off, part), _summed(J, part)
        counts = J_parts > LEAST * J_parts.mean(0)
        B = counts.sum(0).double()
        ratio = torch.where(counts, of_parts.square() / J_parts.clamp_min(1e-300), torch.zeros_like(J_parts))
        between = ratio.sum(0) / (B - 1).clamp_min(1)
        within = off.square().sum(0) / total * len(off) / max(len(off) - 1, 1)
        spread = (between - within).clamp_min(0) / (total / B.clamp_min(1))
        return cls(mean, total, within, spread, B, _others(scores.J.sum(0), len(covariance)), covariance)

    def sd(self, J: Float[Tensor, "K C C"], runs: Float[Tensor, " K"]) -> Float[Tensor, "K C"]:
        """Of d - d_ref over data of this information, from so many runs."""
        away = _others(J, len(self.covariance)) - self.others
        leak = torch.einsum("kcf,fg,kcg->kc", away, self.covariance, away).clamp_min(0)
        own = J.diagonal(dim1=1, dim2=2).clamp_min(1e-300)
        new = self.variance / own + self.spread / runs[:, None].clamp_min(1)
        return (new + self.variance / self.J + self.spread / self.parts.clamp_min(1) + leak).sqrt()


@dataclass(frozen=True, eq=False)
class Found:
    """A change, and from which stretch on.

    Args:
        change: its number.
        stretch: number of the stretch.
        size: d, within bounds.
        sd: of it.
        half: half the width of the 90 % interval.
        p: for C changes and K stretches.
        alike: numbers of the changes that explain the same.
    """

    change: int
    stretch: int
    size: float
    sd: float
    half: float
    p: float
    alike: tuple[int, ...]


def strongest(
    reference: Reference,
    new: Scores,
    stretch: Int[Tensor, " W"],
    run: Int[Tensor, " W"],
    room: tuple[Float[Tensor, " C"], Float[Tensor, " C"]],
    level: float,
) -> Found | None:
    """The change that explains most of what rings, None where nothing does.

    Args:
        reference: what it is compared with.
        new: scores of the new windows.
        stretch, run: of each window; stretches in the order of time from 0.
        room: largest changes down and up.
        level: of p.
    """
    K = int(stretch.max()) + 1
    u, J = (_from_each_on(_summed(one, stretch, K)) for one in (new.u, new.J))
    own = J.diagonal(dim1=1, dim2=2)
    score = u - reference.mean * own
    size = torch.minimum(torch.maximum(score / own.clamp_min(1e-300), room[0]), room[1])
    # What a size within the bounds explains: the square of score / sqrt(J) where it is free.
    explained = (2 * size * score - size.square() * own).clamp_min(0)
    runs = torch.tensor([len(run[stretch >= k].unique()) for k in range(K)], dtype=torch.float64)
    sd = reference.sd(J, runs)
    t = (explained / own.clamp_min(1e-300)).sqrt() / sd
    told = (own > LEAST * reference.J / reference.parts.clamp_min(1)) & (reference.parts >= FEWEST_PARTS)
    p = two_sided(torch.where(told, t, torch.zeros_like(t)), reference.parts - 1) * (_weights(K)[:, None] * t.shape[1])
    if not bool((p < level).any()):
        return None
    best = torch.where(p < level, explained, -torch.ones_like(p))
    change = int(best.amax(0).argmax())
    k = int(torch.where(p[:, change] < level, explained[:, change], -1.0).argmax())
    half = float(sd[k, change]) * float(student.ppf((1 + INTERVAL) / 2, float(reference.parts[change]) - 1))
    return Found(
        change,
        k,
        float(size[k, change]),
        float(sd[k, change]),
        half,
        min(float(p[k, change]), 1.0),
        _alike(reference, score[k], J[k], change),
    )


def _alike(reference: Reference, score: Float[Tensor, " C"], J: Float[Tensor, "C C"], change: int) -> tuple[int, ...]:
    """Changes beside which the one found says nothing more."""
    others = []
    for j in range(len(score)):
        left = float(J[change, change] - J[change, j] ** 2 / J[j, j].clamp_min(1e-300))
        if j == change or float(J[j, j]) <= 0:
            continue
        more = float(score[change] - J[change, j] * score[j] / J[j, j])
        beside = abs(more) / math.sqrt(max(left, 1e-300) * float(reference.variance[change]))
        alone = abs(float(score[j])) / math.sqrt(float(J[j, j] * reference.variance[j]))
        if beside < float(student.ppf(0.975, float(reference.parts[change]) - 1)) and alone > beside:
            others.append((alone, j))
    return tuple(j for _, j in sorted(others, reverse=True))


def two_sided(t: Float[Tensor, "K C"], freedom: Float[Tensor, " C"]) -> Float[Tensor, "K C"]:
    """P(|t| > t) of Student's t."""
    return torch.as_tensor(2 * student.sf(t.numpy(), freedom.clamp_min(1).numpy()))


def error_rise(
    reference: Float[Tensor, " W"], part: Int[Tensor, " W"], new: Float[Tensor, " V"], stretch: Int[Tensor, " V"]
) -> tuple[float, float]:
    """Ratio of the mean squares of a window, new over reference, and the probability that an unchanged machine has it.

    The largest over the new stretches from each on; one-sided, by the scatter of the logarithm over the reference.
    """
    K = int(stretch.max()) + 1
    old = (_summed(reference, part) / _summed(torch.ones_like(reference), part)).clamp_min(1e-300).log()
    summed = _from_each_on(_summed(new.clamp_min(0), stretch, K)) / _from_each_on(
        _summed(torch.ones_like(new), stretch, K)
    )
    rise = summed.clamp_min(1e-300).log() - float(old.mean())
    t = rise / (float(old.std()) * math.sqrt(1 + 1 / len(old)))
    p = student.sf(t.numpy(), len(old) - 1) * _weights(K).numpy()
    best = int(p.argmin())
    return math.exp(float(rise[best])), min(float(p[best]), 1.0)


def _weights(stretches: int) -> Float[Tensor, " K"]:
    """w_k."""
    weight = torch.full((stretches,), 2.0 * (stretches - 1), dtype=torch.float64)
    weight[0] = 2.0 if stretches > 1 else 1.0
    return weight


def _others(J: Float[Tensor, "*K C C"], fitted: int) -> Float[Tensor, "*K C F"]:
    """By how much an error of a fitted parameter moves d of each change; not by its own."""
    g = J[..., :fitted] / J.diagonal(dim1=-2, dim2=-1).clamp_min(1e-300)[..., None]
    own = torch.zeros(J.shape[-1], fitted, dtype=J.dtype)
    own[range(fitted), range(fitted)] = 1.0
    return torch.where(own > 0, torch.zeros_like(g), g)


def _summed(values: Tensor, of: Int[Tensor, " W"], count: int | None = None) -> Tensor:
    """Sum over the windows of each part."""
    B = int(of.max()) + 1 if count is None else count
    return values.new_zeros(B, *values.shape[1:]).index_add(0, of, values)


def _from_each_on(values: Tensor) -> Tensor:
    """Sum over this and all later stretches."""
    return values.flip(0).cumsum(0).flip(0)
