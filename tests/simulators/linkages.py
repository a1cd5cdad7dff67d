"""Mechanisms whose joints are tied by ``<equality>``, and the closed forms of their positions."""

import numpy as np
from jaxtyping import Float

CRANK, ROD = 0.1, 0.3  # [m]

SLIDER_CRANK = f"""<mujoco>
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="crank">
      <joint name="crank" axis="0 -1 0" damping="0.01"/>
      <inertial pos="0 0 0" mass="0.3" diaginertia="0.001 0.002 0.001"/>
      <body name="rod" pos="{CRANK} 0 0">
        <joint name="rod" axis="0 -1 0"/>
        <inertial pos="{ROD / 2} 0 0" mass="0.2" diaginertia="0.0001 0.0015 0.0015"/>
      </body>
    </body>
    <body name="slider" pos="{CRANK + ROD} 0 0">
      <joint name="slider" type="slide" axis="1 0 0"/>
      <geom type="box" size="0.03 0.02 0.02" mass="0.5" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <equality><connect name="pin" body1="rod" body2="slider" anchor="{ROD} 0 0"/></equality>
  <actuator><motor name="motor" joint="crank"/></actuator>
</mujoco>"""

GRIPPER = """<mujoco>
  <worldbody>
    <body name="left" pos="0 0.5 0">
      <joint name="left" type="slide" axis="0 1 0" damping="2"/>
      <geom size="0.01" mass="0.1"/>
    </body>
    <body name="right" pos="0 -0.5 0">
      <joint name="right" type="slide" axis="0 -1 0" damping="2"/>
      <geom size="0.01" mass="0.1"/>
    </body>
  </worldbody>
  <equality><joint joint1="right" joint2="left" polycoef="0.01 2 0 0 0"/></equality>
  <actuator><motor name="motor" joint="left"/></actuator>
</mujoco>"""


def slider_crank(angle: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T 3"]:
    """Positions of crank, rod and slider at these angles of the crank [rad, rad, m]."""
    lean = -np.arcsin(CRANK * np.sin(angle) / ROD)
    reach = CRANK * np.cos(angle) + ROD * np.cos(lean)
    return np.stack([angle, lean - angle, reach - CRANK - ROD], -1)


def driven_slider_crank(
    friction: float, runs: int, seconds: float, step: float = 2e-4, row: float = 0.005
) -> dict[str, dict[str, Float[np.ndarray, " T"]]]:
    """Logs of a crank that a controller turns, half of the runs round and round, from one equation of motion.

        J(q) q'' + J'(q) q'^2 / 2 + g dz/dq = u - 0.01 q' - friction sign(x') dx/dq

    Args:
        friction: on the slider [N].
        runs, seconds: how many, and how long each is [s].
        step, row: of the integration (Runge and Kutta's method) and of the log [s].
    """
    rng = np.random.default_rng(0)
    q, v = np.full(runs, 1.5), np.zeros(runs)
    size, rate, phase = (rng.uniform(low, high, (3, runs)) for low, high in ((0.3, 0.8), (0.3, 1.2), (0.0, 6.0)))
    turning = 2.5 * (np.arange(runs) % 2 == 0)
    times, rows = np.arange(0.0, seconds, row), []
    for t in times:
        wanted = 1.5 + turning * t + 0.5 * (size * np.sin(2 * np.pi * rate * t + phase)).sum(0)
        u = np.clip(6.0 * (wanted - q) - 0.25 * v, -3.0, 3.0)
        rows.append((u, q + 1e-4 * rng.normal(size=runs)))
        for _ in range(round(row / step)):
            a1 = _acceleration(q, v, u, friction)
            a2 = _acceleration(q + step / 2 * v, v + step / 2 * a1, u, friction)
            a3 = _acceleration(q + step / 2 * v + step**2 / 4 * a1, v + step / 2 * a2, u, friction)
            a4 = _acceleration(q + step * v + step**2 / 2 * a2, v + step * a3, u, friction)
            q, v = q + step * v + step**2 / 6 * (a1 + a2 + a3), v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    u, crank = (np.stack(column) for column in zip(*rows, strict=True))
    return {f"r{k}": {"time": times, "ctrl.motor": u[:, k], "qpos.crank": crank[:, k]} for k in range(runs)}


def _acceleration(
    q: Float[np.ndarray, " R"], v: Float[np.ndarray, " R"], u: Float[np.ndarray, " R"], friction: float
) -> Float[np.ndarray, " R"]:
    slide, height, J = _geometry(q)
    bend = (_geometry(q + 1e-5)[2] - _geometry(q - 1e-5)[2]) / 2e-5
    rubs = friction * np.tanh(slide * v / 1e-3) * slide
    return (u - 0.01 * v - bend * v**2 / 2 - 0.2 * 9.81 * height - rubs) / J


def _geometry(q: Float[np.ndarray, " R"]) -> tuple[Float[np.ndarray, " R"], ...]:
    """d slider / dq [m], d (height of the rod's centre) / dq [m] and the inertia at the crank [kg m^2]."""
    lean = -np.arcsin(CRANK * np.sin(q) / ROD)
    leans = -CRANK * np.cos(q) / (ROD * np.cos(lean))
    slide = -CRANK * np.sin(q) - ROD * np.sin(lean) * leans
    across = -CRANK * np.sin(q) - ROD / 2 * np.sin(lean) * leans
    height = CRANK * np.cos(q) + ROD / 2 * np.cos(lean) * leans
    return slide, height, 0.002 + 0.2 * (across**2 + height**2) + 0.0015 * leans**2 + 0.5 * slide**2
