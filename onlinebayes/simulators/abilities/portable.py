"""A simulator's system as its engine's own file holds it, and what stands beside that file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from jaxtyping import Float
from torch import Tensor

from onlinebayes.simulators.base import Simulator


@dataclass(frozen=True, eq=False)
class InFile:
    """One world of a simulator as a file of its engine replays it.

    Args:
        simulator: without the effects that such a file cannot hold, integrated as the file says.
        theta: its parameters (P,) [SI].
        without: keys of these effects -> why, as a clause.
        integrated: how the file is integrated otherwise than the simulator, and why, a clause each.
    """

    simulator: Simulator
    theta: Float[Tensor, " P"]
    without: Mapping[str, str]
    integrated: tuple[str, ...]


class Portable(Simulator):
    """A simulator that can be a file of its engine; by default it cannot."""

    def in_file(self: Self, theta: Float[Tensor, " P"]) -> InFile | None:
        """One world as a file of the engine replays it; None where there are no such files."""
        return None
