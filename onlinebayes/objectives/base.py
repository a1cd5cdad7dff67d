"""The interface of an objective: a policy to act with, and one pass of learning over fresh data."""

from __future__ import annotations

from dataclasses import asdict, is_dataclass
from typing import Any, Protocol, runtime_checkable

from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase

from onlinebayes.transforms import Distribution


@runtime_checkable
class Objective(Protocol):
    """A policy and the way it learns."""

    @property
    def policy(self) -> TensorDictModuleBase:
        """``"observation"`` (..., O) -> ``"action"``, stochastic unless the exploration type says otherwise."""

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """Learn from one batch (N, T) of a collector; returns the means of the losses by name."""

    def state_dict(self) -> dict[str, Any]:
        """Weights and optimiser state, to be saved."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`state_dict` gave."""


@runtime_checkable
class TakesBelief(Protocol):
    """An objective, or a policy, that acts on the belief itself, as a planner does; most only act in its worlds."""

    def set_belief(self, belief: Distribution, /) -> None:
        """Act for the worlds of this belief from now on."""


def settings_of(objective: Objective) -> dict[str, Any]:
    """The settings that an objective was built with, by name; none for one that keeps no ``settings``."""
    settings = getattr(objective, "settings", None)
    return asdict(settings) if is_dataclass(settings) and not isinstance(settings, type) else {}
