"""Limits of the driver of a skid-steered vehicle, which turns a travel and a turn into wheel speeds.

    turn_limit           the turn asked for, as half the difference of the wheels' speeds, is cut off [rad/s]
    wheel_saturation     where a wheel would turn faster than a limit, both are slowed by one factor [rad/s]
    travel_acceleration  the mean of the wheels' speeds changes no faster than a limit [rad/s^2]
    turn_acceleration    half their difference changes no faster than a limit [rad/s^2]

Slowing both wheels by one factor keeps the curvature of the path. Limits of speed and acceleration, each for travel and
for turn, are those of ROS's ``diff_drive_controller``, which such vehicles commonly run (ros2_controllers, user
documentation of ``diff_drive_controller``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Self, final

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Effect, Scales


@dataclass(frozen=True)
class DriverLimit(Effect):
    """A limit of the driver; its upper bound is no limit at all.

    Args:
        target: the vehicle.
        limit: bounds of the limit [:attr:`unit`].

    Attributes:
        unit: of the limit.
        smallest, largest: bounds between which it is looked for.
        within_reach: limits that bind on such vehicles, from which screening begins.
    """

    target: str
    limit: Parameter
    target_kind = "body"
    unit: ClassVar[str]
    smallest: ClassVar[float]
    largest: ClassVar[float]
    within_reach: ClassVar[tuple[float, ...]]

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Self:
        """From a limit that stops the vehicle to one that none reaches."""
        return cls(target, Parameter(cls.smallest, cls.largest, cls.unit))

    @property
    def parameters(self) -> ParameterSpace:
        """``limit``."""
        return ParameterSpace({"limit": self.limit})

    @property
    def neutral(self) -> Mapping[str, float]:
        """The upper bound."""
        return {"limit": self.limit.high}

    @property
    def starts(self) -> tuple[Mapping[str, float], ...]:
        """Those within reach: a limit out of reach moves nothing, however it changes."""
        low, high = self.limit.low, self.limit.high
        return tuple({"limit": limit} for limit in self.within_reach if low < limit < high)


@final
@dataclass(frozen=True)
class TurnLimit(DriverLimit):
    """The driver asks for no faster turn than this."""

    name = "turn_limit"
    unit = "rad/s"
    smallest, largest, within_reach = 0.1, 100.0, (2.0, 4.0, 8.0)


@final
@dataclass(frozen=True)
class WheelSaturation(DriverLimit):
    """No wheel is driven faster than this, whatever the driver makes of both commands."""

    name = "wheel_saturation"
    unit = "rad/s"
    smallest, largest, within_reach = 0.1, 100.0, (4.0, 8.0, 16.0)


@final
@dataclass(frozen=True)
class TravelAcceleration(DriverLimit):
    """The wheels' mean speed changes no faster than this."""

    name = "travel_acceleration"
    unit = "rad/s^2"
    smallest, largest, within_reach = 0.1, 1e4, (3.0, 10.0, 30.0)


@final
@dataclass(frozen=True)
class TurnAcceleration(DriverLimit):
    """Half the difference of the wheels' speeds changes no faster than this."""

    name = "turn_acceleration"
    unit = "rad/s^2"
    smallest, largest, within_reach = 0.1, 1e4, (1.0, 3.0, 10.0)
