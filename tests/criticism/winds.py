"""Two laws of nobody's vocabulary on a slide, each a load and quadratic drag in one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self, final

from jaxtyping import Float
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.effects.scales import Scales
from onlinebayes.simulators.effects.seen import Seen


@dataclass(frozen=True)
class _Wind(Effect, ABC):
    """On a joint."""

    target: str
    target_kind = "joint"

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """Not asked for in tests."""
        return cls(target)

    @property
    @abstractmethod
    def parameters(self) -> ParameterSpace:
        """Around 0."""

    @property
    def neutral(self) -> Mapping[str, float]:
        """None."""
        return dict.fromkeys(self.parameters, 0.0)


@final
@dataclass(frozen=True)
class HeadWind(_Wind):
    """load - k v abs(v): both free."""

    name = "head_wind"

    @property
    def parameters(self) -> ParameterSpace:
        """``drag``, ``load``."""
        return ParameterSpace({"drag": Parameter(0.0, 5.0), "load": Parameter(-5.0, 5.0, "N")})

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """[N]."""
        return parameters["load"] - parameters["drag"] * seen.v * seen.v.abs()


@final
@dataclass(frozen=True)
class WindOfOneSize(_Wind):
    """size (1 - 8 v abs(v)): one number for both."""

    name = "wind_of_one_size"

    @property
    def parameters(self) -> ParameterSpace:
        """``size``."""
        return ParameterSpace({"size": Parameter(-5.0, 5.0, "N")})

    def force(self, parameters: Mapping[str, Tensor], seen: Seen) -> Float[Tensor, " N"]:
        """[N]."""
        return parameters["size"] * (1 - 8.0 * seen.v * seen.v.abs())
