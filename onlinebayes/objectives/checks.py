"""What every objective refuses: numbers with which nothing can be learnt, actions without bounds."""

from __future__ import annotations

import math

from torchrl.data import Bounded

from onlinebayes.runs import BadInput


def check_numbers(*, gamma: float, positive: dict[str, float], counts: dict[str, int]) -> None:
    """Refuse numbers with which nothing can be learnt.

    Args:
        gamma: discount factor, from 0 to below 1.
        positive: by name.
        counts: by name; one or more each.

    Raises:
        BadInput: one of them is not so.
    """
    if not 0 <= gamma < 1:
        raise BadInput(f"gamma = {gamma:g}", "a discount factor is at least 0 and below 1")
    for name, value in positive.items():
        if not 0 < value < math.inf:
            raise BadInput(f"{name} = {value:g}", "it must be positive and finite")
    for name, count in counts.items():
        if count < 1:
            raise BadInput(f"{name} = {count}", "it must be one or more")


def check_bounds(action_spec: Bounded) -> None:
    """Refuse an action without finite bounds.

    Raises:
        BadInput: a bound is infinite.
    """
    low, high = action_spec.space.low, action_spec.space.high
    if not (low.isfinite().all() and high.isfinite().all()):
        raise BadInput(f"the action's bounds are {low.tolist()} and {high.tolist()}", "give it finite bounds")
