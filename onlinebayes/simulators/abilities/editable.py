"""The same system with a number freed, other bounds, or a known change of its build."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Self, TypeVar

from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

S = TypeVar("S")


class Editable(Simulator):
    """A simulator that makes variants of itself; by default there are none."""

    @property
    def own_numbers(self) -> Mapping[str, Parameter]:
        """Addresses of the model's own numbers that may be off -> how far; none by default."""
        return {}

    def with_free(self, name: str, parameter: Parameter) -> Self:
        """A new simulator one more of whose :attr:`own_numbers` is a parameter; all worlds nominal.

        Raises:
            BadInput: there is no such number, or it is free already.
        """
        raise BadInput(f"{type(self).__name__} has no number '{name}' to free", "override own_numbers and with_free")

    def with_bounds(self, name: str, parameter: Parameter) -> Self:
        """A new simulator whose free parameter ``name`` has other bounds; all worlds nominal.

        Raises:
            BadInput: there is no such parameter, or this simulator's bounds are fixed.
        """
        raise BadInput(f"the bounds of {type(self).__name__} are fixed", "override with_bounds to let them be judged")

    def with_gravity_compensation(self: S) -> S | None:
        """The same system with its weight carried by its drives; None where that is not possible or changes nothing."""
        return None

    def with_payload(self, body: str, mass: float) -> Self:
        """A new simulator with a known point mass [kg] at a body's centre of mass, besides what its parameters say.

        Raises:
            BadInput: no such body, or this simulator has none.
        """
        raise BadInput(f"{type(self).__name__} has no bodies to fix {mass:g} kg to", "leave the payload out")
