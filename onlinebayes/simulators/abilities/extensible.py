"""The targets on which effects can act in a simulator, and their sizes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from onlinebayes.simulators.abilities.measured import Measured

if TYPE_CHECKING:
    from onlinebayes.simulators.effects import Contact, Effect, TargetKind


class Extensible(Measured):
    """A simulator that says what :meth:`~onlinebayes.simulators.Simulator.with_effect` can take; all has a default."""

    @property
    def joint_kinds(self) -> Mapping[str, Literal["slide", "hinge"]]:
        """Kind of each slide and hinge joint, which decides units; joints that it lacks are taken for hinges."""
        return {}

    def targets(self, kind: TargetKind) -> tuple[str, ...]:
        """List the targets of one kind, by name; bodies, geoms, the world only where a backend has them."""
        if kind == "actuator":
            return self.commands
        if kind == "signal":
            return self.signals
        if kind == "parameter":
            return tuple(name for name in self.parameters if "@" not in name)
        names = (name.removeprefix("qpos.") for name in self.signals if name.startswith("qpos."))
        return tuple(names) if kind == "joint" else ()

    @property
    def own_effects(self) -> Mapping[str, type[Effect]]:
        """Effects that the system's own equations hold (tyres, fluids), by name, besides the general vocabulary."""
        return {}

    @property
    def body_sizes(self) -> Mapping[str, tuple[float, float]]:
        """Mass [kg] and size [m] of each of the bodies among :meth:`targets`, as the system was built."""
        return {}

    @property
    def moving_joints(self) -> Mapping[str, tuple[str, ...]]:
        """Joints that move each of the bodies among :meth:`targets`; without those of which that is not known."""
        return {}

    @property
    def servos(self) -> Mapping[str, tuple[str, ...]]:
        """Joints of which an actuator holds a position -> these actuators; none by default."""
        return {}

    @property
    def contacts(self) -> Mapping[str, Contact]:
        """Contact properties of each of the geoms and bodies among :meth:`targets` of geoms, as built."""
        return {}
