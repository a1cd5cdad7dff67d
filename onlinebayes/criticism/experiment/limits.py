"""Limits of a recording on the machine: of command, rate, travel and speed, from the measurements and the model.

| quantity                | bound, where the user gives none                                                     |
|-------------------------|--------------------------------------------------------------------------------------|
| command                 | the model's ``ctrlrange``; without one the largest measured ``abs(u)``, either sign  |
| rate of the command     | the largest measured ``abs(u_{i+1} - u_i) / h``                                      |
| position                | the joint's range in the model; without one the measured travel, 10 % longer         |
| speed                   | 1.2 times the largest measured one                                                   |
| length                  | 12 horizons, or the longest run where that is longer                                 |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism.candidates.scales import target_scales
from onlinebayes.identification.data.windows import Windows, joint_names
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.abilities import Extensible, Measured
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco import MujocoSimulator

HORIZONS = 12
LONGER_TRAVEL, FASTER = 0.1, 1.2
INSIDE = 0.02  # of a joint's range, kept from its stops


@dataclass(frozen=True)
class Payload:
    """A known mass that may be fixed to a body, at that body's centre of mass.

    Args:
        body: name of the body.
        mass: m > 0 [kg].
    """

    body: str
    mass: float

    def __post_init__(self) -> None:
        if not 0 < self.mass < float("inf"):
            raise BadInput(f"a payload of {self.mass} kg", "give a positive mass in kg")


@dataclass(frozen=True)
class Allowed:
    """The limits that the user allows; an empty table or None leaves them to the measurements and the model.

    Args:
        max_command: actuator -> largest ``abs(u)`` [command units].
        max_rate: actuator -> largest ``abs(du/dt)`` [command units/s].
        travel: joint -> (lowest, highest) position [m, rad].
        max_speed: joint -> largest speed [m/s, rad/s].
        seconds: length of the recording [s].
        payload: a mass that may be fixed to a body.
    """

    max_command: Mapping[str, float] = field(default_factory=dict)
    max_rate: Mapping[str, float] = field(default_factory=dict)
    travel: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    max_speed: Mapping[str, float] = field(default_factory=dict)
    seconds: float | None = None
    payload: Payload | None = None


@dataclass(frozen=True)
class Limits:
    """Limits of an input and of the motion that it causes; U commands, J joints, in the simulator's order.

    Args:
        command_low, command_high: [command units].
        rate: largest change of each command [command units/s].
        travel_low, travel_high: positions [m, rad].
        speed: [m/s, rad/s].
        seconds: length of the recording T [s].
    """

    command_low: Float[Tensor, " U"]
    command_high: Float[Tensor, " U"]
    rate: Float[Tensor, " U"]
    travel_low: Float[Tensor, " J"]
    travel_high: Float[Tensor, " J"]
    speed: Float[Tensor, " J"]
    seconds: float


def find_limits(
    simulator: Identifiable, measurement: Measurement, windows: Windows, allowed: Allowed, least_seconds: float
) -> Limits:
    """The limits for one model and what was measured of it.

    Args:
        simulator: the model.
        measurement: the fit runs, their commands in any order.
        windows: of the same runs, from which travel and speed are read.
        allowed: what the user says; goes before everything else.
        least_seconds: what enough independent blocks need [s].

    Raises:
        BadInput: no actuators, or nothing that may be commanded.
    """
    if not simulator.commands:
        raise BadInput("the model has no actuators", "there is no command to propose: add an actuator to the model")
    command = _commands(simulator, measurement, allowed)
    if not bool((command[1] > command[0]).any()):
        raise BadInput(
            "no command ever differs from zero, so nothing is known to be admissible",
            "give max_command under [next]",
        )
    longest = max(HORIZONS * windows.horizon, least_seconds, *measurement.durations)
    seconds = longest if allowed.seconds is None else allowed.seconds
    if seconds < 2 * windows.horizon:
        raise BadInput(
            f"a recording of {seconds:g} s is shorter than two windows of {windows.horizon:g} s",
            "give more seconds under [next]",
        )
    return Limits(
        *command, _rates(simulator, measurement, allowed, *command), *_motion(simulator, windows, allowed), seconds
    )


def _commands(
    simulator: Extensible, measurement: Measurement, allowed: Allowed
) -> tuple[Float[Tensor, " U"], Float[Tensor, " U"]]:
    low, high = [], []
    for name in simulator.commands:
        largest = float(_column(measurement, name).abs().max())
        bounds = (-largest, largest) if name in simulator.targets("actuator") else (0.0, 0.0)
        if isinstance(simulator, MujocoSimulator):
            actuator = simulator.model.actuator(name)
            if bool(actuator.ctrllimited[0]):
                bounds = (float(actuator.ctrlrange[0]), float(actuator.ctrlrange[1]))
        if name in allowed.max_command:
            most = allowed.max_command[name]
            bounds = (-most, most)
        low.append(bounds[0])
        high.append(bounds[1])
    like = measurement.data["signal"]
    return like.new_tensor(low), like.new_tensor(high)


def _rates(
    simulator: Measured, measurement: Measurement, allowed: Allowed, low: Tensor, high: Tensor
) -> Float[Tensor, " U"]:
    """Largest admissible rates; where the measured command never changed, the whole range in a second."""
    time, both = measurement.data["time"], measurement.data["mask"][:, 1:]
    gaps = (time[:, 1:] - time[:, :-1]).clamp_min(1e-12)
    rates = []
    for k, name in enumerate(simulator.commands):
        u = measurement.data["command"][..., measurement.commands.index(name)]
        measured = float(((u[:, 1:] - u[:, :-1]).abs() / gaps)[both].max())
        found = measured if measured > 0 else float(high[k] - low[k])
        rates.append(allowed.max_rate.get(name, found))
    return low.new_tensor(rates)


def _motion(
    simulator: Identifiable, windows: Windows, allowed: Allowed
) -> tuple[Float[Tensor, " J"], Float[Tensor, " J"], Float[Tensor, " J"]]:
    low, high, speed = [], [], []
    for name in joint_names(simulator):
        scales = target_scales(simulator, windows, "joint", name)
        reach = (0.5 + LONGER_TRAVEL) * scales.travel
        bounds = (scales.centre - reach, scales.centre + reach)
        if isinstance(simulator, MujocoSimulator):
            joint = simulator.model.joint(name)
            if bool(simulator.model.jnt_limited[joint.id]):
                a, b = (float(edge) for edge in joint.range)
                bounds = (a + INSIDE * (b - a), b - INSIDE * (b - a))
        bounds = allowed.travel.get(name, bounds)
        low.append(bounds[0])
        high.append(bounds[1])
        speed.append(allowed.max_speed.get(name, FASTER * scales.speed))
    like = windows.start
    return like.new_tensor(low), like.new_tensor(high), like.new_tensor(speed)


def _column(measurement: Measurement, command: str) -> Float[Tensor, " n"]:
    u = measurement.data["command"][..., measurement.commands.index(command)]
    return torch.where(measurement.data["mask"], u, 0.0).flatten()
