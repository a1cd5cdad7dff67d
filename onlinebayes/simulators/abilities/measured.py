"""The signals that a simulator measures, its commands, and the effects that it carries."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from jaxtyping import Float
from tensordict import TensorDictBase
from torch import Tensor

from onlinebayes.simulators.base import Simulator

if TYPE_CHECKING:
    from onlinebayes.simulators.effects import Effect


class Measured(Simulator):
    """A simulator whose columns have names.

    Attributes:
        commands: names of the U command columns, e.g. ``("motor",)``.
        signals: names of the S signals that :meth:`read` gives, e.g. ``("qpos.hinge", "qvel.hinge")``.
        effects: the effects added so far, in order.
    """

    commands: tuple[str, ...]
    signals: tuple[str, ...]
    effects: tuple[Effect, ...]

    @abstractmethod
    def read(self, state: TensorDictBase) -> Float[Tensor, "*batch S"]:
        """The signals of a state or trajectory, in the order of :attr:`signals`."""
