"""Trajectories that are much shorter or longer than those that a posterior was learnt from.

An embedding that averages over steps says the same of 5 steps as of 50, and a network that has seen 20 to 50 answers
with their widths. About n steps tell theta to a standard deviation proportional to n^(-1/2): a quarter fewer make it
15 % too small, and 5 in the place of 20 half as wide as it is.
"""

from __future__ import annotations

import logging
from typing import NamedTuple

from jaxtyping import Bool
from torch import Tensor

NEAR = 4 / 3
"""Ratio of lengths up to which nothing is said."""

_log = logging.getLogger(__name__)
_SAID: set[tuple[tuple[int, int], bool]] = set()


class Lengths(NamedTuple):
    """Recorded steps of the shortest and of the longest trajectory."""

    shortest: int
    longest: int

    @classmethod
    def of(cls, mask: Bool[Tensor, "B T"]) -> Lengths:
        """Of trajectories, those without a step left out; 0 and 0 of none."""
        steps = mask.sum(1)
        steps = steps[steps > 0]
        return cls(int(steps.min()), int(steps.max())) if len(steps) else cls(0, 0)

    def __str__(self) -> str:
        return f"{self.shortest}" if self.shortest == self.longest else f"{self.shortest} to {self.longest}"

    def warn(self, asked: Lengths) -> None:
        """Log one line, where a posterior learnt from these is asked about much shorter or longer ones.

        The next ones that are too short, or too long, for a posterior of the same lengths are not told again.
        """
        short, long = NEAR * asked.shortest < self.shortest, asked.longest > NEAR * self.longest
        if not self.longest or not asked.longest or not (short or long) or (self, short) in _SAID:
            return
        _SAID.add((self, short))
        _log.warning(
            "a posterior learnt from trajectories of %s steps is asked about %s: its widths may be far too %s;"
            " simulate trajectories of that length",
            self,
            asked,
            "narrow" if short else "wide",
        )
