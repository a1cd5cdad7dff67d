"""Faults between a rig and its log, and the table that each of them leaves behind.

| fault                | what the log shows                                               |
|----------------------|------------------------------------------------------------------|
| sign                 | a position with its sign turned                                  |
| degrees              | an angle in degrees                                              |
| offset               | a position from another zero                                     |
| swapped              | two positions in one another's columns                           |
| latency              | a position some rows late                                        |
| command_unit         | a command ten times too small or too large                       |
| actuator_off         | commands as ever, while the actuators were off for a part of each run |
| gravity_compensation | commands without what the amplifier added to hold the weight     |
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from envs.rigs.recording import Interference
from envs.rigs.rig import Rig

LATENCY = (0.02, 0.06)  # [s]
OFF = 0.2  # share of a run

# Gravity tells where zero is and can be compensated; on a level rail neither is anything.
_WEIGHED = ("swing", "two_link_arm", "six_joint_arm", "position_servo")
_HINGED = (*_WEIGHED, "cart_pole")
# Where each joint moves by itself, late signals are late motors, or start later: nobody could tell.
_APART = ("slide_drive", "swing", "position_servo", "pushed_block", "thrown_ball")
_TWINS = {"cart_pole": (0, 1), "two_link_arm": (0, 1), "six_joint_arm": (1, 2), "thrown_ball": (0, 1)}


@final
@dataclass(frozen=True)
class Fault:
    """A fault.

    Args:
        kind: as in the module's table.
        column, other: the columns concerned.
        size: an offset [m, rad], a factor, or a latency [s].
    """

    kind: str
    column: str = ""
    other: str = ""
    size: float = 0.0

    @property
    def name(self) -> str:
        """``kind column size``, as far as there are any."""
        size = f"{self.size:.4g}" if self.size else ""
        return " ".join(part for part in (self.kind, self.column, self.other, size) if part)

    @property
    def interference(self) -> Interference:
        """Interference with the commands while the rig runs."""
        return Interference(
            off=OFF if self.kind == "actuator_off" else 0.0, compensation=self.kind == "gravity_compensation"
        )

    @staticmethod
    def drawn(rig: Rig, draw: np.random.Generator) -> Fault:
        """One of the faults that make sense on a rig."""
        kinds = ["sign", *(["latency"] if rig.name not in _APART else []), "command_unit", "actuator_off"]
        kinds += ["offset", "gravity_compensation"] if rig.name in _WEIGHED else []
        # A servo's own loop knows nothing of a torque added to its goal.
        kinds = [kind for kind in kinds if kind != "gravity_compensation" or rig.name != "position_servo"]
        kinds += ["degrees"] if rig.name in _HINGED else []
        kinds += ["swapped"] if rig.name in _TWINS else []
        kind = str(draw.choice(kinds))
        turning = [joint for joint in rig.joints if joint not in ("slider", "lift")]
        joint, actuator = str(draw.choice(turning)), rig.actuators[draw.integers(len(rig.actuators))].name
        if kind == "offset":
            # The base of a vertical axis is weightless: its zero is nobody's question.
            joint = str(draw.choice([name for name in turning if name not in ("j1", "j6")]))
        size = {
            "offset": float(draw.choice([-1, 1]) * draw.uniform(0.15, 0.5)),
            "latency": float(draw.uniform(*LATENCY)),
            "command_unit": float(draw.choice([0.1, 10.0])),
        }.get(kind, 0.0)
        if kind == "swapped":
            first, second = _TWINS[rig.name]
            return Fault(kind, f"qpos.{rig.joints[first]}", f"qpos.{rig.joints[second]}")
        columns = {"command_unit": f"ctrl.{actuator}", "actuator_off": "", "gravity_compensation": ""}
        return Fault(kind, columns.get(kind, f"qpos.{joint}"), size=size)


def miswired(table: Mapping[str, Float[ndarray, " T"]], fault: Fault) -> dict[str, Float[ndarray, " T"]]:
    """The table of one run, as it is logged with that fault; velocities follow their positions."""
    changed = dict(table)
    related = [name for name in (fault.column, fault.column.replace("qpos.", "qvel.")) if name in table]
    for name in dict.fromkeys(related):
        x = table[name]
        if fault.kind == "sign":
            changed[name] = -x
        elif fault.kind == "degrees":
            changed[name] = np.rad2deg(x)
        elif fault.kind == "offset" and name.startswith("qpos."):
            changed[name] = x + fault.size
        elif fault.kind == "latency":
            rows = max(1, round(fault.size / float(np.median(np.diff(table["time"])))))
            changed[name] = np.concatenate([np.repeat(x[:1], rows), x[:-rows]])
        elif fault.kind == "command_unit":
            changed[name] = fault.size * x
        elif fault.kind == "swapped":
            other = name.replace(fault.column[5:], fault.other[5:])
            changed[name], changed[other] = table[other], x
    return changed
