"""Sensors of a model as signals: which numbers of ``sensordata`` they are, at the state they belong to.

| signal                         | reads                                                                              |
|--------------------------------|------------------------------------------------------------------------------------|
| ``sensor.<name>``, ``.0`` ...  | that sensor of the model, one number or several                                    |
| ``qfrc.<joint>``               | the actuators' force at a slide or hinge joint, ``qfrc_actuator`` [N, N m]         |

``mj_step`` computes sensors before it moves the state; here they are computed again at each row's own state, with the
command that was held until it, as a controller reads its sensors before it sends the next command.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import mujoco

from onlinebayes.runs import BadInput, nearest
from onlinebayes.simulators.mujoco.addresses import HINGE, SLIDE, names, scalar_joint

TORQUE = "qfrc."
SENSOR = "sensor."


def add_torque_sensors(spec: mujoco.MjSpec, model: mujoco.MjModel, signals: Sequence[str]) -> None:
    """Give the spec a sensor for every ``qfrc.<joint>`` among the signals.

    Args:
        spec: changed.
        model: compiled from it, for its joints.
        signals: names; others are left alone.

    Raises:
        BadInput: there is no such joint, or it is a free or ball joint.
    """
    for signal in signals:
        if signal.startswith(TORQUE):
            joint = signal.removeprefix(TORQUE)
            scalar_joint(model, joint)
            spec.add_sensor(
                name=signal,
                type=mujoco.mjtSensor.mjSENS_JOINTACTFRC,
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
                objname=joint,
            )


def sensor_signals(model: mujoco.MjModel) -> dict[str, int]:
    """Signal -> its place in ``sensordata``, for every named sensor of a model."""
    found: dict[str, int] = {}
    for i, name in enumerate(names(model, "sensor")):
        if not name:
            continue
        first, width = int(model.sensor_adr[i]), int(model.sensor_dim[i])
        signal = name if name.startswith(TORQUE) else f"{SENSOR}{name}"
        found |= {signal: first} if width == 1 else {f"{signal}.{k}": first + k for k in range(width)}
    return found


def measured_sensors(model: mujoco.MjModel, columns: Collection[str]) -> list[str]:
    """The model's sensors and joint torques that a log's columns hold, in the model's order."""
    joints = [name for name, kind in zip(names(model, "joint"), model.jnt_type, strict=True) if kind in (SLIDE, HINGE)]
    known = dict.fromkeys([*sensor_signals(model), *(f"{TORQUE}{joint}" for joint in joints)])
    return [signal for signal in known if signal in columns]


def sensor_places(model: mujoco.MjModel, signals: Sequence[str]) -> tuple[int, ...]:
    """Places in ``sensordata`` of some signals.

    Raises:
        BadInput: the model has no such sensor; names the nearest.
    """
    known = sensor_signals(model)
    for signal in signals:
        if signal not in known:
            raise BadInput(f"the model has no sensor signal '{signal}'", nearest(signal, known))
    return tuple(known[signal] for signal in signals)
