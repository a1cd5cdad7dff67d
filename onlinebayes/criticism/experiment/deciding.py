"""When a recording decides: where the rule that will judge it can be expected to prefer what is true.

    gain >= 0.05 nats,      gain >= 2 se        (:mod:`.judging.rule`),      strength: how far both are reached, 1: just

Where the other model misses x standard deviations (:mod:`.separation`), the log-likelihood gains x^2 / 2 with a
standard error of x, so that two standard errors are x = 4. The gain is 1/2 log(1 + odds). The odds go with the square
of an effect's size, as x does with the size, as far as its law is linear in it: one 1 / strength times as large would
just be accepted.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.experiment.rivals import Size
from onlinebayes.identification.judging.rule import LEAST_GAIN, STANDARD_ERRORS

PARTED = 2 * STANDARD_ERRORS
"""Standard deviations that the other model must miss."""


def strength(sigma: Float[Tensor, "*batch"], gain: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Compute the strength with which an input decides, 1 being enough."""
    asked = torch.tensor(LEAST_GAIN, dtype=gain.dtype, device=gain.device)
    return torch.minimum(sigma / PARTED, (_odds(gain) / _odds(asked)).sqrt())


def rescaled(gain: Float[Tensor, "*batch"], factor: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """The gain where the separation is so many times as large."""
    return 0.5 * (factor.square() * _odds(gain)).log1p()


def accepted_from(size: Size | None, strong: float) -> float | None:
    """The size of an effect from which on it would be accepted; None where none is added, or nothing shows of it."""
    if size is None or not strong > 0:
        return None
    return size.neutral + (size.value - size.neutral) / strong


def _odds(gain: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    return torch.expm1(2 * gain.clamp_min(0.0))
