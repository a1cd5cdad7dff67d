"""A rig driven and read: commands, true motion, what its sensors say.

    reading = resolution round(((1 + s) q(t - T) + b + b_run + noise) / resolution)
    u_k = input_k, or under feedback u_k = kp (goal_k - reading_k) + kd d/dt (goal - reading), differences filtered

Rows fall on steps of the integrator, so that a command changes exactly where the log says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from envs.rigs.equations import Values
from envs.rigs.inputs import inputs
from envs.rigs.rig import Protocol, Rig

FILTER = 0.02  # time constant of the controller's differences [s]
CHANGE = 0.5  # from one amplitude of a run to its next [s]


@final
@dataclass(frozen=True)
class Recording:
    """R runs of T rows.

    Args:
        time: of the rows [s].
        command: held from its row to the next.
        reading, speed: what the sensors of n joints say; s = n, or 0 where no speed is measured.
        q, v: the true motion [SI].
    """

    time: Float[ndarray, " T"]
    command: Float[ndarray, "T R m"]
    reading: Float[ndarray, "T R n"]
    speed: Float[ndarray, "T R s"]
    q: Float[ndarray, "T R n"]
    v: Float[ndarray, "T R n"]


@final
@dataclass(frozen=True)
class Interference:
    """Disturbances that the operator does not write down.

    Args:
        off: share of a run in which the actuators are off, from 0.4 of its length on.
        compensation: does the amplifier add the torques that hold the model's weight?
    """

    off: float = 0.0
    compensation: bool = False


@final
@dataclass(frozen=True)
class Habits:
    """Differences between the runs.

    Args:
        zeros: what the encoders say at zero, by run [m, rad].
        reach: factors of the inputs' amplitude in the first two thirds of a run, and in its last.
    """

    zeros: Float[ndarray, "R n"]
    reach: Float[ndarray, "R 2"]

    def stretched(self, goal: Float[ndarray, "T R m"], times: Float[ndarray, " T"]) -> Float[ndarray, "T R m"]:
        """The inputs with these amplitudes, half a second from one to the other."""
        later = np.clip((times - 2 / 3 * times[-1]) / CHANGE, 0.0, 1.0)[:, None]
        factor = (1 - later) * self.reach[:, 0] + later * self.reach[:, 1]
        return factor[:, :, None] * goal


def record(
    rig: Rig,
    values: Values,
    draw: np.random.Generator,
    *,
    runs: int,
    seconds: float,
    interference: Interference | None = None,
    habits: Habits | None = None,
) -> Recording:
    """Drive R runs of a rig at once.

    Args:
        rig: which.
        values: addresses -> values [SI], base and hidden.
        draw: decides inputs, jitter, starts and noise.
        runs: R.
        seconds: length of a run [s].
        interference: what is done to the commands and not logged.
        habits: how the runs differ; None where all are alike.
    """
    protocol, n = rig.protocol, len(rig.joints)
    at = _rows(protocol, seconds, draw)
    times, amplitude = at * protocol.step, np.array(protocol.amplitude)
    goal = amplitude * inputs(times, (runs, len(rig.actuators)), protocol.band, draw)
    goal = goal if habits is None else habits.stretched(goal, times)
    zeros = np.zeros((runs, n)) if habits is None else habits.zeros
    sensor = _Sensor(rig, values, draw.standard_normal((len(at), runs, 2 * n)), zeros)
    controller = _Controller(rig, goal, times)
    amplifier = _Amplifier(rig, values, interference or Interference(), float(times[-1]))
    plant = rig.plant(values, *_start(protocol, (runs, n), draw))
    q, v = (np.empty((at[-1] + 1, runs, n)) for _ in range(2))
    q[0], v[0] = plant.q, plant.v
    command = np.empty_like(goal)
    reading = np.empty((len(at), runs, n))
    for k, step in enumerate(at.tolist()):
        reading[k] = sensor.position(k, step, q)
        command[k] = controller.command(k, reading[k])
        until = int(at[k + 1]) if k + 1 < len(at) else step
        for j in range(step, until):
            plant.drive.on = amplifier.on(j * protocol.step)
            plant.advance(amplifier.sent(command[k], plant.q))
            q[j + 1], v[j + 1] = plant.q, plant.v
    speed = sensor.speed(v[at]) if protocol.speed_sd else np.empty((len(at), runs, 0))
    return Recording(times, command, reading, speed, q[at], v[at])


def _rows(protocol: Protocol, seconds: float, draw: np.random.Generator) -> Int[ndarray, " T"]:
    """The steps on which rows fall."""
    at = np.arange(0, round(seconds / protocol.step) + 1, protocol.period)
    early_or_late = draw.integers(-protocol.jitter, protocol.jitter + 1, len(at))
    early_or_late[0] = 0
    return at + early_or_late


def _start(
    protocol: Protocol, shape: tuple[int, int], draw: np.random.Generator
) -> tuple[Float[ndarray, "R n"], Float[ndarray, "R n"]]:
    speed = np.array(protocol.start) if protocol.start else np.zeros(shape[1])
    return np.zeros(shape), speed * draw.uniform(-1, 1, shape)


@final
class _Sensor:
    """The encoders of n joints."""

    def __init__(
        self, rig: Rig, values: Values, noise: Float[ndarray, "T R both"], zeros: Float[ndarray, "R n"]
    ) -> None:
        def at(effect: str, parameter: str) -> Float[ndarray, " n"]:
            return np.array([values.get(f"{effect}@qpos.{joint}.{parameter}", 0.0) for joint in rig.joints])

        self.protocol, self.noise = rig.protocol, noise
        self.bias, self.scale = at("sensor_bias", "bias") + zeros, at("sensor_scale", "scale")
        self.late = at("sensor_delay", "delay") / rig.protocol.step

    def position(self, row: int, step: int, q: Float[ndarray, "S R n"]) -> Float[ndarray, "R n"]:
        """Readings at a row [m, rad]; before the log the joints rested where they start."""
        exact, joints = np.maximum(step - self.late, 0.0), np.arange(q.shape[2])
        first = np.floor(exact).astype(int)
        share = exact - first
        seen = (1 - share) * q[first, :, joints].T + share * q[np.minimum(first + 1, step), :, joints].T
        noisy = (1 + self.scale) * seen + self.bias + self.protocol.sd * self.noise[row, :, : len(joints)]
        return np.round(noisy / self.protocol.resolution) * self.protocol.resolution

    def speed(self, v: Float[ndarray, "T R n"]) -> Float[ndarray, "T R n"]:
        """Measured velocities [m/s, rad/s]."""
        return v + np.array(self.protocol.speed_sd) * self.noise[:, :, v.shape[2] :]


@final
class _Controller:
    """Inputs as they are, or a PD controller that follows them."""

    def __init__(self, rig: Rig, goal: Float[ndarray, "T R m"], times: Float[ndarray, " T"]) -> None:
        self.goal, self.times, self.gains = goal, times, rig.protocol.feedback
        self.joints = [actuator.joint for actuator in rig.actuators]
        self._error, self._slope = np.zeros(goal.shape[1:]), np.zeros(goal.shape[1:])

    def command(self, row: int, reading: Float[ndarray, "R n"]) -> Float[ndarray, "R m"]:
        """The command of this row; six digits, as a log would have them."""
        if not self.gains:
            return _digits(self.goal[row])
        kp, kd = np.array(self.gains).T
        error = self.goal[row] - reading[:, self.joints]
        if row:
            dt = self.times[row] - self.times[row - 1]
            share = 1 - math.exp(-dt / FILTER)
            self._slope = self._slope + share * ((error - self._error) / dt - self._slope)
        self._error = error
        return _digits(kp * error + kd * self._slope)


@final
class _Amplifier:
    """The amplifier, which decides what is really sent to the actuators."""

    def __init__(self, rig: Rig, values: Values, interference: Interference, end: float) -> None:
        self.interference = interference
        self.equations = rig.equations({**rig.nominal, **values})
        self.joints = [actuator.joint for actuator in rig.actuators]
        self.between = 0.4 * end, (0.4 + interference.off) * end

    def on(self, time: float) -> bool:
        """Check whether the actuators give force."""
        return not (self.interference.off and self.between[0] <= time < self.between[1])

    def sent(self, command: Float[ndarray, "R m"], q: Float[ndarray, "R n"]) -> Float[ndarray, "R m"]:
        """The command, or the command and the weight."""
        if not self.interference.compensation:
            return command
        return command + self.equations.bias(q, np.zeros_like(q))[:, self.joints]


def _digits(x: Float[ndarray, "R m"]) -> Float[ndarray, "R m"]:
    return np.round(x, 6)
