"""Skill of a replay over the naive continuation of a signal: nothing is named from a signal in which it has none.

naive:  q_0 + v_0 t  for a position,  v_0  for a velocity,   q_0 and v_0 the best ones of each window
skill:  left-out RMS of the hypothesis < RMS that the naive continuation leaves,   or no more than noise is left
"""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.projection import per_noise
from onlinebayes.identification.fitting.rows import rms
from onlinebayes.identification.judging.evaluator import AT_FLOOR, Evaluation, Evaluator
from onlinebayes.identification.judging.rule import LEAST_GAIN


def unskilled(found: Evaluation, evaluator: Evaluator) -> tuple[str, ...]:
    """Names of the signals in which a hypothesis has no skill."""
    windows, left = evaluator.windows, found.left_out[0].rms
    names = [evaluator.given.signals[column] for column in windows.columns]
    lost = (left >= naive_rms(windows, names)) & (left > AT_FLOOR)
    return tuple(name for name, one in zip(names, lost.tolist(), strict=True) if one)


def has_skill(found: Evaluation, evaluator: Evaluator) -> bool:
    """Check whether something moves that the naive continuation misses, and the hypothesis has skill in all of it."""
    windows = evaluator.windows
    naive = naive_rms(windows, [evaluator.given.signals[column] for column in windows.columns])
    moving = naive > AT_FLOOR
    return bool(moving.any()) and bool((found.left_out[0].rms < naive)[moving].all())


def gains_with_skill(found: Evaluation, base: Evaluation, evaluator: Evaluator) -> bool:
    """Check whether a hypothesis gains enough in the signals in which it has skill."""
    lost = unskilled(found, evaluator)
    names = [evaluator.given.signals[column] for column in evaluator.windows.columns]
    each = zip(names, found.gains(base)[0].by_signal, strict=True)
    return not lost or sum(gain for name, gain in each if name not in lost) >= LEAST_GAIN


def naive_rms(windows: Windows, names: list[str]) -> Float[Tensor, " S"]:
    """RMS of every signal around its naive continuation, over all windows [noise floors]."""
    scaled = windows.bin(windows.value) * per_noise(windows)
    time = torch.linspace(0, 1, windows.bins, dtype=scaled.dtype, device=scaled.device)
    lines = torch.stack([torch.ones_like(time), time], dim=1)
    left = torch.zeros_like(scaled)
    for s, name in enumerate(names):
        terms = lines[:, :1] if name.startswith("qvel.") else lines
        left[:, :, s] = _around(terms, scaled[:, :, s], windows.seen[:, :, s])
    return rms(windows, left)


def _around(
    terms: Float[Tensor, "n k"], value: Float[Tensor, "W n"], seen: Bool[Tensor, "W n"]
) -> Float[Tensor, "W n"]:
    """Return the residual of the best combination of the terms in every window, where something was seen."""
    weight = seen.to(value)
    A, y = terms * weight[..., None], (value * weight)[..., None]
    # A trifle on the diagonal: a window may hold fewer bins than terms.
    normal = A.mT @ A + 1e-12 * torch.eye(terms.shape[1]).to(value)
    return (y - A @ torch.linalg.solve(normal, A.mT @ y))[..., 0]
