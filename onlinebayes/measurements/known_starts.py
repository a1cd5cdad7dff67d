"""Prior knowledge of the state in which a run begins, or a window of it, before any model is fitted.

    value given:  s ~ N(value, sd^2)      where the run begins; s = value exactly where sd is 0
    sd alone:     s ~ N(measured, sd^2)   in every window

A robot that stands still before each run, a ball that is let go, a pose that is counted from the run's first row: the
log does not have to tell these again. A start that is free to lie anywhere explains a missing law away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class KnownStart:
    """Prior knowledge of one coordinate of the start, ``qpos.<joint>`` or ``qvel.<joint>``.

    Args:
        value: it where the run begins [SI]; None for the value that was measured, in every window.
        sd: standard deviation of what is known [SI]; 0 for a value that is known exactly.

    Raises:
        BadInput: an sd that is negative or not finite, a value that is not finite, or nothing that is known.
    """

    value: float | None = None
    sd: float = 0.0

    def __post_init__(self) -> None:
        if self.value is not None and not math.isfinite(self.value):
            raise BadInput(f"value = {self.value:g} is not finite", "give the value where a run begins")
        if not (0.0 <= self.sd < math.inf):
            raise BadInput(f"sd = {self.sd:g} is no standard deviation", "give a positive number, or 0 with a value")
        if self.value is None and self.sd == 0.0:
            raise BadInput(
                "neither a value nor an sd is given", "give the value where a run begins, or the sd of a measured start"
            )
