"""Checks of every objective's arguments: it refuses numbers that prevent learning, and actions without bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral
from typing import Any

from torch import nn
from torchrl.data import Bounded

from onlinebayes.runs import BadInput


def check_discount(gamma: float) -> None:
    """Refuse a discount factor that is not at least 0 and below 1.

    Raises:
        BadInput: it is not.
    """
    if not 0 <= gamma < 1:
        raise _refused("gamma", gamma, "a discount factor is at least 0 and below 1")


def check_positive(**numbers: float) -> None:
    """Refuse numbers, by name, that are not positive and finite.

    Raises:
        BadInput: one of them is not.
    """
    for name, number in numbers.items():
        if not 0 < number < math.inf:
            raise _refused(name, number, "it must be positive and finite")


def check_weights(**numbers: float) -> None:
    """Refuse weights of terms of a loss, by name, that are negative or infinite.

    Raises:
        BadInput: one of them is.
    """
    for name, number in numbers.items():
        if not 0 <= number < math.inf:
            raise _refused(name, number, "it must be finite and not negative")


def check_shares(**numbers: float) -> None:
    """Refuse shares, by name, that are not from 0 to 1.

    Raises:
        BadInput: one of them is not.
    """
    for name, number in numbers.items():
        if not 0 <= number <= 1:
            raise _refused(name, number, "a share is at least 0 and at most 1")


def check_counts(**numbers: int) -> None:
    """Refuse counts, by name, that are not whole numbers of one or more.

    Raises:
        BadInput: one of them is not.
    """
    for name, number in numbers.items():
        if not isinstance(number, Integral) or number < 1:
            raise _refused(name, number, "it must be a whole number, one or more")


def check_rate_of_targets(tau: float) -> None:
    """Refuse a rate with which targets would not follow, or overshoot.

    Raises:
        BadInput: it is not above 0 and at most 1.
    """
    if not 0 < tau <= 1:
        raise _refused("tau", tau, "targets follow with a rate above 0 and at most 1")


def check_bound_on_gradients(max_grad_norm: float) -> None:
    """Refuse a bound on the gradient's norm with which nothing moves.

    Raises:
        BadInput: it is not above 0.
    """
    if not max_grad_norm > 0:
        raise BadInput(f"max_grad_norm = {max_grad_norm}: it must be above 0", "give infinity for no bound")


def check_layers(widths: Sequence[int], activation: Any) -> None:
    """Refuse hidden layers without units, and an activation that is no class of modules.

    Raises:
        BadInput: there is one of either.
    """
    if any(not isinstance(width, Integral) or width < 1 for width in widths):
        raise _refused("widths", tuple(widths), "a layer has a whole number of units, one or more")
    if not (isinstance(activation, type) and issubclass(activation, nn.Module)):
        raise BadInput(f"activation = {activation!r}: it must be a class of torch.nn", "give torch.nn.ReLU, say")


def check_bounds(action_spec: Bounded) -> None:
    """Refuse an action without finite bounds.

    Raises:
        BadInput: a bound is infinite.
    """
    low, high = action_spec.space.low, action_spec.space.high
    if not (low.isfinite().all() and high.isfinite().all()):
        raise BadInput(f"the action's bounds are {low.tolist()} and {high.tolist()}", "give it finite bounds")


def _refused(name: str, value: Any, rule: str) -> BadInput:
    return BadInput(f"{name} = {value}: {rule}", f"give another {name}, or leave it out for the usual one")
