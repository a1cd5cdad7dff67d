"""A quadrotor that a controller flies from place to place, from equations and an integrator of its own, and a camera.

    m a = R (0, 0, sum t) + m g,    I w' = M t - w x I w,    q' = q (0, w) / 2,    tau t' = u - t

M holds the rotors' places and their reaction. The camera sees position and attitude, the log holds what was commanded.
"""

from __future__ import annotations

import numpy as np

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.tumbling import rotated

ARM, REACTION = 0.1, 0.02  # [m]
MASS, INERTIA = 0.55, np.array([2.2e-3, 2.5e-3, 4.1e-3])  # [kg], [kg m2]
NOISE = 1e-3  # [m]; of each part of the quaternion [1]
ROW, STEPS = 0.01, 10  # [s]
PLACES = ARM * np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
SPIN = np.array([1.0, -1.0, 1.0, -1.0])
MIX = np.stack([np.ones(4), PLACES[:, 1], -PLACES[:, 0], SPIN * REACTION])
ROTORS = "".join(
    f'<motor name="rotor{k}" site="rotor{k}" gear="0 0 1 0 0 {spin * REACTION}"/>' for k, spin in enumerate(SPIN)
)
SITES = "".join(f'<site name="rotor{k}" pos="{x} {y} 0"/>' for k, (x, y) in enumerate(PLACES))
XML = f"""
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body name="frame"><freejoint name="base"/>
  <inertial pos="0 0 0" mass="0.5" diaginertia="0.002 0.002 0.004"/>{SITES}
  <geom type="box" size=".1 .1 .02" contype="0" conaffinity="0"/>
</body></worldbody><actuator>{ROTORS}</actuator></mujoco>"""
POSE = tuple(f"qpos.base.{k}" for k in range(7))


def model() -> MujocoSimulator:
    moment = Parameter(7e-4, 1.2e-2, "kg m2")
    free = {"body.frame.mass": Parameter(0.2, 1.5, "kg"), **{f"body.frame.inertia[{k}]": moment for k in range(3)}}
    return MujocoSimulator(XML, ParameterSpace(free), threads=1)


def slope(state: np.ndarray, u: np.ndarray, lag: float) -> np.ndarray:
    """d/dt of (position, quaternion, velocity, angular velocity, thrusts), (R, 17)."""
    q, v, w, t = state[:, 3:7], state[:, 7:10], state[:, 10:13], state[:, 13:]
    thrust, *moment = MIX @ (t if lag else u).T
    up = np.stack([0 * thrust, 0 * thrust, thrust / MASS], 1)
    turn = (np.stack(moment, 1) - np.cross(w, INERTIA * w)) / INERTIA
    turning = 0.5 * np.concatenate(
        [-(q[:, 1:] * w).sum(1, keepdims=True), q[:, :1] * w + np.cross(q[:, 1:], w)], axis=1
    )
    return np.concatenate(
        [v, turning, rotated(q, up) - np.array([0, 0, 9.81]), turn, (u - t) / lag if lag else 0 * t], axis=1
    )


def controlled(state: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Thrusts [N] of a controller that flies to a goal, with the mass of the model."""
    q = state[:, 3:7]
    wish = np.clip(4 * (goal - state[:, :3]) - 3 * state[:, 7:10], -5, 5) + np.array([0, 0, 9.81])
    axis = rotated(q, np.tile([0.0, 0.0, 1.0], (len(q), 1)))
    tilt = np.cross(axis, wish / np.linalg.norm(wish, axis=1, keepdims=True))
    tilt = rotated(q * np.array([1, -1, -1, -1]), tilt)
    moment = np.array([0.35, 0.35, 0.02]) * tilt - np.array([0.045, 0.045, 0.012]) * state[:, 10:13]
    asked = np.concatenate([0.5 * (wish * axis).sum(1, keepdims=True), moment], axis=1)
    return np.clip(asked @ np.linalg.inv(MIX).T, 0, 4)


def measure(lag: float, runs: int = 5, seconds: float = 5.0, seed: int = 0) -> Measurement:
    """Flights, recorded from their second second on, of rotors with a time constant ``lag`` [s], or with none."""
    draw = np.random.default_rng(seed)
    goals = draw.uniform([-1.5, -1.5, 0.8], [1.5, 1.5, 2.5], (round(seconds / 1.5) + 2, runs, 3))
    state = np.zeros((runs, 17))
    state[:, 2], state[:, 3], state[:, 13:] = 1.5, 1.0, MASS * 9.81 / 4
    before = round(1 / ROW)
    rows = before + round(seconds / ROW)
    commands, poses = np.empty((rows, runs, 4)), np.empty((rows, runs, 7))
    step = ROW / STEPS
    for k in range(rows):
        commands[k], poses[k] = controlled(state, goals[int(k * ROW / 1.5)]), state[:, :7]
        for _ in range(STEPS):
            k1 = slope(state, commands[k], lag)
            k2 = slope(state + 0.5 * step * k1, commands[k], lag)
            k3 = slope(state + 0.5 * step * k2, commands[k], lag)
            k4 = slope(state + step * k3, commands[k], lag)
            state = state + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        state[:, 3:7] /= np.linalg.norm(state[:, 3:7], axis=1, keepdims=True)
    commands, poses = commands[before:], poses[before:]
    seen = poses + NOISE * draw.normal(size=poses.shape)
    time = np.arange(len(poses)) * ROW
    tables = {
        f"flight{r}": {
            "time": time,
            **{f"ctrl.rotor{k}": commands[:, r, k] for k in range(4)},
            **dict(zip(POSE, seen[:, r].T, strict=True)),
        }
        for r in range(runs)
    }
    signals = [Signal(name, "m" if k < 3 else "", sd=NOISE) for k, name in enumerate(POSE)]
    return Measurement.from_runs(tables, signals=signals, commands=[f"rotor{k}" for k in range(4)])
