"""A term that MuJoCo has for an effect: it stands in the place of the effect's own law, and goes into exported MJCF.

Effects say what they do; the engine says how it has that. Every term adds to what stands in the fields already.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Generic, TypeAlias, TypeVar

import mujoco
import numpy as np

from onlinebayes.simulators.effects import Effect

E = TypeVar("E", bound=Effect)
Arrays: TypeAlias = Mapping[str, np.ndarray]


class NativeTerm(ABC, Generic[E]):
    """MuJoCo's term for one kind of effect.

    Attributes:
        fields: MjModel fields that :meth:`write` sets per world.
        excludes: addresses of the model's parameters beside which the effect cannot stand while they are free.
    """

    fields: tuple[str, ...]
    excludes: tuple[str, ...] = ()

    def edit(self, spec: mujoco.MjSpec, effect: E) -> None:
        """Change the structure once, before compiling (an extra actuator, a solver setting); nothing by default."""

    @abstractmethod
    def write(self, model: mujoco.MjModel, fields: Arrays, effect: E, parameters: Arrays) -> None:
        """Set the per-world model fields from the effect's parameters.

        Args:
            model: the compiled model, for ids and base values.
            fields: field name -> live array (N, ...), **already holding the values without this effect**.
            effect: whose term it is.
            parameters: short name -> values (N,) [SI].
        """
