"""When a recording decides: 3 sigma, and of an effect that is added the fall of the error that acceptance asks for.

    strength = min(sigma, 3 (o(fall) / o(5 %))^(1/2)),     o(f) = 1 / (1 - f)^2 - 1 = E / S     (:mod:`.separation`)

decides from 3 on. Both terms grow with the effect's size as that itself does, as far as its law is linear in it: a size
3 / strength times as large would just be accepted.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.experiment.rivals import Size
from onlinebayes.identification.judging.rule import LEAST_GAIN

PARTED = 3.0


def strength(sigma: Float[Tensor, "*batch"], fall: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """How far an input decides, 3 being enough; sigma alone where no effect is added (fall is nan)."""
    asked = PARTED * (_odds(fall) / (1 / (1 - LEAST_GAIN) ** 2 - 1)).sqrt()
    return torch.where(fall.isnan(), sigma, torch.minimum(sigma, asked))


def rescaled(fall: Float[Tensor, "*batch"], factor: float | Tensor) -> Float[Tensor, "*batch"]:
    """The fall where the separation is so many times as large."""
    return 1 - (1 + factor**2 * _odds(fall)).rsqrt()


def accepted_from(size: Size | None, strong: float) -> float | None:
    """The size of an effect from which on it would be accepted; None where none is added, or nothing shows of it."""
    if size is None or not strong > 0:
        return None
    return size.neutral + (size.value - size.neutral) * PARTED / strong


def _odds(fall: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    return ((1 - fall).clamp_min(1e-12) ** -2 - 1).clamp_min(0.0)
