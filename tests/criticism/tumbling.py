"""A tumbling block with a thruster, from equations and an integrator of its own, and a noisy camera that sees its pose.

    m a = R (0, 0, u) + m g,      I w' = -c x (0, 0, u) - w x I w,      q' = q (0, w) / 2,      origin = centre - R c

The thruster pushes at the block's origin along its z axis, c is the centre of mass in the block's frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

BLOCK = """
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body name="block">
  <freejoint name="pose"/><inertial pos="0 0 0" mass="2" diaginertia=".02 .03 .045"/><site name="nozzle"/>
  <geom type="box" size=".2 .15 .05" contype="0" conaffinity="0"/>
</body></worldbody><actuator><general name="thruster" site="nozzle" gear="0 0 1 0 0 0"/></actuator></mujoco>"""

FREE = ParameterSpace(
    {"body.block.mass": Parameter(1.0, 4.0, "kg"), "body.block.inertia[0]": Parameter(0.012, 0.029, "kg m2")}
)
TRUTH = (2.3, 0.024)
NOISE = 1e-3  # [m]; of each part of the quaternion [1]
STEP, ROW = 0.0025, 0.01  # [s]
POSE = tuple(f"qpos.pose.{k}" for k in range(7))


@dataclass(frozen=True)
class Block:
    """What the block is; SI units."""

    mass: float = TRUTH[0]
    inertia: tuple[float, float, float] = (TRUTH[1], 0.03, 0.045)
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)


def model(parameters: ParameterSpace = FREE) -> MujocoSimulator:
    return MujocoSimulator(BLOCK, parameters, threads=1)


def rotated(q: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R(q) x, batched."""
    t = 2 * np.cross(q[:, 1:], x)
    return x + q[:, :1] * t + np.cross(q[:, 1:], t)


def slope(state: np.ndarray, u: np.ndarray, block: Block) -> np.ndarray:
    """d/dt of (centre, velocity, quaternion, angular velocity), (R, 13)."""
    v, q, w = state[:, 3:6], state[:, 6:10], state[:, 10:]
    inertia = np.array(block.inertia)
    thrust = np.stack([0 * u, 0 * u, u], -1)
    a = rotated(q, thrust) / block.mass + np.array([0, 0, -9.81])
    torque = -np.cross(np.array(block.centre), thrust) - np.cross(w, inertia * w)
    turning = 0.5 * np.concatenate(
        [-(q[:, 1:] * w).sum(1, keepdims=True), q[:, :1] * w + np.cross(q[:, 1:], w)], axis=1
    )
    return np.concatenate([v, a, turning, torque / inertia], axis=1)


@cache
def fly(block: Block, runs: int, seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Commands (runs, rows) [N], exact poses (runs, rows, 7), exact velocities (runs, rows, 6) as MuJoCo has them."""
    draw = np.random.default_rng(seed)
    rows, per = round(seconds / ROW) + 1, round(ROW / STEP)
    t = np.arange(rows) * ROW
    tones = 2 * np.pi * draw.uniform(0.3, 2.0, (runs, 3, 1)) * t + draw.uniform(0, 6.3, (runs, 3, 1))
    u = 8 * np.sin(tones).sum(1)
    q = draw.normal(size=(runs, 4))
    state = np.concatenate(
        [
            np.zeros((runs, 3)),
            draw.normal(0, 1, (runs, 3)),
            q / np.linalg.norm(q, axis=1, keepdims=True),
            draw.normal(0, 3, (runs, 3)),
        ],
        axis=1,
    )
    poses, rates = np.empty((runs, rows, 7)), np.empty((runs, rows, 6))
    centre = np.array(block.centre)[None]
    for k in range(rows):
        q = state[:, 6:10]
        w = state[:, 10:]
        poses[:, k] = np.concatenate([state[:, :3] - rotated(q, centre), q], axis=1)
        rates[:, k] = np.concatenate([state[:, 3:6] - rotated(q, np.cross(w, centre)), w], axis=1)
        for _ in range(per):
            k1 = slope(state, u[:, k], block)
            k2 = slope(state + 0.5 * STEP * k1, u[:, k], block)
            k3 = slope(state + 0.5 * STEP * k2, u[:, k], block)
            k4 = slope(state + STEP * k3, u[:, k], block)
            state = state + STEP / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        state[:, 6:10] /= np.linalg.norm(state[:, 6:10], axis=1, keepdims=True)
    return u, poses, rates


def table(
    block: Block, runs: int = 9, seconds: float = 3.0, seed: int = 0, noise: float = NOISE
) -> dict[str, dict[str, np.ndarray]]:
    """What the camera saw, run by run."""
    u, poses, _ = fly(block, runs, seconds, seed)
    seen = poses + noise * np.random.default_rng(seed + 1).normal(size=poses.shape)
    time = np.arange(u.shape[1]) * ROW
    return {
        f"run{r}": {
            "time": time,
            "ctrl.thruster": u[r],
            **dict(zip(POSE, seen[r].T, strict=True)),
        }
        for r in range(runs)
    }


def measure(block: Block, runs: int = 9, seconds: float = 3.0, seed: int = 0, noise: float = NOISE) -> Measurement:
    return measurement(table(block, runs, seconds, seed, noise), noise)


def measurement(runs: dict[str, dict[str, np.ndarray]], noise: float = NOISE) -> Measurement:
    signals = [Signal(name, "m" if k < 3 else "", sd=noise) for k, name in enumerate(POSE)]
    return Measurement.from_runs(runs, signals=signals, commands=["thruster"])
