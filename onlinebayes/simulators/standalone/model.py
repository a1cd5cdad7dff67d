"""One world of a model file with laws that MuJoCo has no term for, stepped by MuJoCo and numpy alone.

    ctrl = laws of the command;   qfrc_applied, dof_frictionloss, dof_armature = laws of actuators, then of joints

The order and the instants are those of :mod:`onlinebayes.simulators.mujoco.stage`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from onlinebayes.simulators.standalone.drive import Drive
from onlinebayes.simulators.standalone.law import Law, Seen, Servo, clip

Row = Sequence[float] | np.ndarray

KINDS = ("command", "actuator", "joint", "signal")
"""What a law acts on: an actuator's command or force, a joint, a sensor's signal."""


@dataclass
class Setup:
    """What stands beside a model file.

    Args:
        timestep: of the integration [s].
        integrator: name of ``mjtIntegrator``.
        ctrl: places of the commands in ``ctrl``.
        signals: names of all positions and velocities, then sensors.
        sensors: places of those sensors in ``sensordata``.
        slopes: place of each scalar position among the signals -> that of its velocity.
        numbers: field of the model -> its flat place -> value, where the file has another one.
        constants: whether the constants that MuJoCo derives have to be derived anew.
        undelayed: actuators whose delay in the file is a law here.
        laws: (``name@target``, which of KINDS it acts on, name of that, law), in their order.
    """

    timestep: float
    integrator: str
    ctrl: tuple[int, ...]
    signals: tuple[str, ...]
    sensors: tuple[int, ...]
    slopes: Mapping[int, int]
    numbers: Mapping[str, Mapping[int, float]]
    constants: bool
    undelayed: tuple[str, ...]
    laws: tuple[tuple[str, str, str, Law], ...]


class Place:
    """The place where a law acts on a joint: columns in ``qpos`` and ``qvel``, and the actuators that it sees.

    Args:
        model: the compiled model.
        kind: ``"joint"`` or ``"actuator"``.
        target: its name.
        ctrl: places of the model's own commands: other actuators are no drive.
    """

    def __init__(self, model: mujoco.MjModel, kind: str, target: str, ctrl: Sequence[int]) -> None:
        on_joints = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
        drives = [Drive(model, i) for i in range(model.nu) if int(model.actuator_trntype[i]) in on_joints]
        drives = [one for one in drives if one.ctrl in ctrl and model.actuator_ctrlnum[one.actuator] == 1]
        if kind == "actuator":
            self.drives = [drive for drive in drives if drive.actuator == model.actuator(target).id]
            joint = self.drives[0].joint
        else:
            joint = int(model.joint(target).id)
            self.drives = [drive for drive in drives if drive.joint == joint]
        self.at_actuator = kind == "actuator"
        self.q, self.v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])

    def see(self, qpos: np.ndarray, qvel: np.ndarray, ctrl: np.ndarray, timestep: float) -> Seen:
        """What a law sees there."""
        q, v = float(qpos[self.q]), float(qvel[self.v])
        servos = [
            drive.servo(float(ctrl[drive.ctrl]), q, v, 1.0 if self.at_actuator else drive.gear) for drive in self.drives
        ]
        force = sum(clip(servo.force, servo.low, servo.high) for servo in servos)
        command = sum(float(ctrl[drive.ctrl]) for drive in self.drives)
        return Seen(q, v, force, command, servos[0] if servos else Servo(0.0, 0.0, 0.0, 0.0, 0.0), timestep)


class StandaloneModel:
    """One world of a model file, with laws beside it.

    Args:
        path: the model file.
        setup: what stands beside it.

    Attributes:
        model, data: MuJoCo's.
    """

    def __init__(self, path: str | Path, setup: Setup) -> None:
        self.setup = setup
        spec = mujoco.MjSpec.from_file(str(path))
        spec.option.timestep = setup.timestep
        spec.option.integrator = getattr(mujoco.mjtIntegrator, setup.integrator)
        for name in setup.undelayed:
            spec.actuator(name).delay, spec.actuator(name).nsample = 0.0, 0
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        for name, values in setup.numbers.items():
            getattr(self.model, name).flat[list(values)] = list(values.values())
        if setup.constants:
            mujoco.mj_setConst(self.model, self.data)
        at = {kind: [(name, law) for _, on, name, law in setup.laws if on == kind] for kind in KINDS}
        self.acting = [
            (Place(self.model, kind, name, setup.ctrl), law) for kind in ("actuator", "joint") for name, law in at[kind]
        ]
        model = self.model
        self.commands = [(int(model.actuator_ctrladr[model.actuator(name).id]), law) for name, law in at["command"]]
        self.sensors = [(setup.signals.index(name), law) for name, law in at["signal"]]
        self.own = [field.copy() for field in (self.model.dof_frictionloss, self.model.dof_armature, self.model.dof_M0)]
        self.reset()

    def reset(self, qpos: Row | None = None, qvel: Row | None = None) -> dict[str, float]:
        """Begin anew, with all laws at rest and no command before; returns the signals.

        Args:
            qpos, qvel: where [m, rad, m/s, rad/s]; as the model file says where they are None.
        """
        mujoco.mj_resetData(self.model, self.data)
        if qpos is not None:
            self.data.qpos[:] = qpos
        if qvel is not None:
            self.data.qvel[:] = qvel
        for _, _, _, law in self.setup.laws:
            law.reset(self.setup.timestep)
        self.start, self.begun = self.motion(), False
        return self.shown(self.start.copy())

    def step(self, ctrl: Row, steps: int = 1) -> dict[str, float]:
        """Advance by some timesteps under one command; returns the signals as the sensors show them.

        Args:
            ctrl: of each actuator of the model [command units].
            steps: how many.
        """
        shown = {}
        for _ in range(steps):
            self.data.ctrl[list(self.setup.ctrl)] = ctrl
            for place, law in self.commands:
                self.data.ctrl[place] = law.command(float(self.data.ctrl[place]))
            self.act()
            mujoco.mj_step(self.model, self.data)
            values = self.motion()
            if not self.begun:  # the first reading of a sensor stands for that at the start
                self.start[self.model.nq + self.model.nv :] = values[self.model.nq + self.model.nv :]
                self.begun = True
            shown = self.shown(values)
        return shown

    def act(self) -> None:
        """Set what the laws do over the timestep to come, and move their hidden states to its end."""
        q, v, h = self.data.qpos.copy(), self.data.qvel.copy(), self.setup.timestep
        done: list[tuple[float, float, float]] = []
        for place, law in self.acting:
            seen = self.see(place, q, v, done)
            done.append(self.of(place, law, seen))
            law.advance(seen)
        self.write(done)
        fresh = [k for k, (_, law) in enumerate(self.acting) if not law.remembers]
        if self.setup.integrator != "mjINT_RK4" or not fresh:
            return
        # Runge and Kutta's method takes laws without memory at the middle of the timestep.
        bits = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(self.model, bits))
        mujoco.mj_getState(self.model, self.data, state, bits)
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, bits)
        for at_q, at_v in {(place.q, place.v) for place, _ in self.acting}:
            q[at_q] += 0.5 * h * v[at_v]
        v = v + 0.5 * h * self.data.qacc
        for k in fresh:
            place, law = self.acting[k]
            done[k] = self.of(place, law, self.see(place, q, v, done))
        self.write(done)

    def see(self, place: Place, q: np.ndarray, v: np.ndarray, done: Sequence[tuple[float, float, float]]) -> Seen:
        """What a law sees, with the force that laws at its actuators have added by now."""
        seen = place.see(q, v, self.data.ctrl, self.setup.timestep)
        if not place.at_actuator:
            for (other, _), (force, _, _) in zip(self.acting, done, strict=False):
                seen.drive += force if other.at_actuator and other.v == place.v else 0.0
        return seen

    def of(self, place: Place, law: Law, seen: Seen) -> tuple[float, float, float]:
        """Force on the joint, bound of friction, and change of inertia by one law."""
        gear = place.drives[0].gear if place.at_actuator else 1.0
        return gear * law.force(seen), law.bound(seen), law.inertia(seen) if law.weighs else 0.0

    def write(self, done: Sequence[tuple[float, float, float]]) -> None:
        """Put what all laws do where MuJoCo reads it."""
        model, data = self.model, self.data
        if not self.acting:
            return
        friction, armature, mass = (own.copy() for own in self.own)
        data.qfrc_applied[:] = 0.0
        for (place, _), (force, bound, inertia) in zip(self.acting, done, strict=True):
            data.qfrc_applied[place.v] += force
            friction[place.v] += bound
            armature[place.v] += inertia
            mass[place.v] += inertia
        model.dof_frictionloss[:] = friction
        if any(law.weighs for _, law in self.acting):
            model.dof_armature[:], model.dof_M0[:] = armature, mass

    def motion(self) -> np.ndarray:
        """Positions, velocities and sensors, as they are."""
        model, data, sensors = self.model, self.data, list(self.setup.sensors)
        if not sensors:
            return np.concatenate([data.qpos, data.qvel])
        bits = mujoco.mjtState.mjSTATE_INTEGRATION
        state = np.empty(mujoco.mj_stateSize(model, bits))
        mujoco.mj_getState(model, data, state, bits)
        mujoco.mj_forward(model, data)
        read = np.concatenate([data.qpos, data.qvel, data.sensordata[sensors]])
        mujoco.mj_setState(model, data, state, bits)
        return read

    def shown(self, values: np.ndarray) -> dict[str, float]:
        """The signals as the sensors show them."""
        for place, law in self.sensors:
            slope = float(self.start[self.setup.slopes[place]]) if place in self.setup.slopes else 0.0
            values[place] = law.sense(float(self.data.time), float(values[place]), float(self.start[place]), slope)
        return dict(zip(self.setup.signals, values.tolist(), strict=True))
