"""The wiring faults that are worth a look for these signals and commands.

Per joint: the sign and the unit of its position, its velocity, or both; a zero a quarter or half a turn away. Of all
hinges, and of all slides, together: their unit. Per pair of joints: their columns swapped. Per orientation: the sign
and the unit of its angular velocity, and what :mod:`.conventions` has. Per sensor: its sign and unit. Of all hinges and
all commands together: their unit. Per actuator: the command's sign and unit; per pair: swapped. And once: a controller
that carries the weight, and, where no orientation is among them, signals or sensors that run ahead of the commands, and
columns a row apart.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from itertools import combinations, groupby

from onlinebayes.criticism.wiring.conventions import conventions
from onlinebayes.criticism.wiring.faults import (
    COMMAND,
    HINGE,
    SENSOR,
    SLIDE,
    Compensated,
    Fault,
    Offset,
    Rescaled,
    Swapped,
    WholeLog,
)
from onlinebayes.criticism.wiring.shifts import is_sensor, shifts
from onlinebayes.identification.data.coordinates import velocity
from onlinebayes.identification.data.windows import joint_names
from onlinebayes.identification.replaying.charted import orientation_paths
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.abilities import Extensible, Measured
from onlinebayes.simulators.identifiable import Identifiable

TURN = 2 * math.pi

TURNS = (math.pi / 2, -math.pi / 2, math.pi)


def possible_faults(simulator: Identifiable, measurement: Measurement, late: bool = False) -> tuple[Fault, ...]:
    """Every fault to try, those of the signals first: where a command's explains as much, the signal's is named first.

    Args:
        simulator: the model; gives joints, their kinds and the actuators.
        measurement: gives the signals that were measured.
        late: whether columns may be late: where effects are tried, that is one.
    """
    measured = {signal.name for signal in measurement.signals}
    return (
        *_of_signals(simulator, measured),
        *conventions(simulator, measured),
        *_of_sensors([signal.name for signal in measurement.signals]),
        *_of_whole_log(simulator, measurement),
        *_of_commands(simulator),
        *(() if orientation_paths(simulator)[0] else shifts(measurement, bool(simulator.commands), late)),
        *([Compensated(tuple(simulator.commands))] if simulator.with_gravity_compensation() is not None else []),
    )


def _of_signals(simulator: Extensible, measured: set[str]) -> Iterator[Fault]:
    # A turn is no column of the table: of an orientation only the velocities are looked at, its three axes together.
    joints = [joint for joint in joint_names(simulator) if f"qvel.{joint}" in simulator.signals]
    for rates in _angular(simulator, measured):
        for factor, instead in {-1.0: "the reversed sign", **HINGE}.items():
            yield Rescaled("signal", rates, factor, instead)
    for joint in joints:
        hinge = simulator.joint_kinds.get(joint, "hinge") == "hinge"
        sets = _columns(joint, measured)
        for names in sets:
            yield Rescaled("signal", names, -1.0, "the reversed sign")
        for factor, instead in (HINGE if hinge else SLIDE).items():
            for names in sets:
                yield Rescaled("signal", names, factor, instead)
        if hinge and f"qpos.{joint}" in measured:
            for turn in TURNS:
                yield Offset(f"qpos.{joint}", turn)
    yield from units_of_all(simulator, measured)
    for a, b in combinations(joints, 2):
        both = [kind for kind in ("qpos", "qvel") if {f"{kind}.{a}", f"{kind}.{b}"} <= measured]
        if "qpos" in both:
            yield Swapped("signal", tuple(f"{kind}.{a}" for kind in both), tuple(f"{kind}.{b}" for kind in both))


def units_of_all(simulator: Extensible, measured: Collection[str]) -> Iterator[Rescaled]:
    """A unit that all hinges have, or all slides, where there are several: a log is written in one unit throughout.

    Args:
        simulator: gives joints and their kinds.
        measured: names of the signals.
    """
    joints = [joint for joint in joint_names(simulator) if f"qvel.{joint}" in simulator.signals]
    kinds = {joint: simulator.joint_kinds.get(joint, "hinge") for joint in joints}
    for kind, units in (("hinge", HINGE), ("slide", SLIDE)):
        columns = [_columns(joint, measured) for joint in joints if kinds[joint] == kind]
        sets = dict.fromkeys(tuple(name for one in columns for name in one[min(k, len(one) - 1)]) for k in range(3))
        for factor, instead in units.items():
            yield from (Rescaled("signal", names, factor, instead) for names in sets if len(columns) > 1 and names)


def _of_whole_log(simulator: Extensible, measurement: Measurement) -> Iterator[WholeLog]:
    """The unit of all hinges and of all commands, where servos drive all of them.

    A machine without a scale of its own looks alike in any unit; one that is more linear than its model looks better in
    a smaller one. So the values must say it, too: in degrees they go beyond a turn in radians.
    """
    joints = [joint for joint in joint_names(simulator) if f"qvel.{joint}" in simulator.signals]
    hinges = [joint for joint in joints if simulator.joint_kinds.get(joint, "hinge") == "hinge"]
    measured = [signal.name for signal in measurement.signals]
    names = tuple(name for joint in hinges for first in _columns(joint, measured)[:1] for name in first)
    places = [measured.index(name) for name in names if name.startswith("qpos.")]
    servos = {actuator for actuators in simulator.servos.values() for actuator in actuators}
    if not places or not simulator.commands or not servos.issuperset(simulator.commands):
        return
    shown = measurement.data["signal"][..., places][measurement.data["measured"][..., places]]
    largest = float(shown.abs().max()) if len(shown) else 0.0
    for factor, instead in HINGE.items():
        if (largest > TURN) if factor < 1 else (0 < largest < TURN / factor):
            signals = Rescaled("signal", names, factor, instead)
            yield WholeLog(signals, Rescaled("command", tuple(simulator.commands), factor, instead))


def _of_sensors(signals: list[str]) -> Iterator[Fault]:
    """All numbers of a sensor together, then each alone where it has several."""
    for names in groupby(filter(is_sensor, signals), lambda name: ".".join(name.split(".")[:2])):
        every = tuple(names[1])
        for columns in [every] if len(every) < 2 else [every, *((name,) for name in every)]:
            yield Rescaled("signal", columns, -1.0, "the reversed sign")
        for factor, instead in SENSOR.items():
            yield Rescaled("signal", every, factor, instead)


def _angular(simulator: Measured, measured: set[str]) -> list[tuple[str, ...]]:
    """The measured angular velocities of each free and ball joint."""
    found: dict[str, list[str]] = {}
    for joint in joint_names(simulator):
        rate = velocity(joint, simulator.signals)
        if rate is not None and rate != f"qvel.{joint}" and rate in measured:
            found.setdefault(joint.rpartition(".")[0], []).append(rate)
    return [tuple(rates) for rates in found.values()]


def _columns(joint: str, measured: Collection[str]) -> list[tuple[str, ...]]:
    """Position and velocity together, then each alone; what was not measured left out."""
    names = tuple(name for name in (f"qpos.{joint}", f"qvel.{joint}") if name in measured)
    return [names] if len(names) < 2 else [names, names[:1], names[1:]]


def _of_commands(simulator: Measured) -> Iterator[Fault]:
    for name in simulator.commands:
        for factor, instead in COMMAND.items():
            yield Rescaled("command", (name,), factor, instead)
    for a, b in combinations(simulator.commands, 2):
        yield Swapped("command", (a,), (b,))
