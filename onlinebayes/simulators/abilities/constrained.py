"""Constraints between the joints of a simulator."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import torch
from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.simulators.base import Simulator


class Constrained(Simulator):
    """A simulator some of whose joints are tied to others; by default none is."""

    def project_onto_constraints(self, state: TensorDictBase) -> TensorDictBase:
        """The nearest states that the system's constraints between joints allow; all states by default."""
        return state

    def with_rigid_constraints(self) -> Self:
        """A new simulator whose constraints between joints are rigid where nobody said how soft they are; or itself."""
        return self

    def constrained_positions(self, path: Float[Tensor, "T J"], known: Sequence[int]) -> Float[Tensor, "T J"]:
        """Positions along a path of the joints that were measured, the others as constraints tie them to these.

        Args:
            path: of all joints; what is not known is overwritten [m, rad].
            known: places of those that were measured.

        Returns:
            The path, nan where nothing ties a joint; by default all that is not known.
        """
        found = torch.full_like(path, torch.nan)
        found[:, list(known)] = path[:, list(known)]
        return found
