"""A problem in a folder: a carriage on a rail, two runs of a simulated drive, a problem file."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

MODEL = """
<mujoco model="carriage">
  <option timestep="0.005" integrator="implicitfast"/>
  <worldbody>
    <body name="carriage">
      <joint name="carriage" type="slide" axis="1 0 0" damping="2"/>
      <geom name="carriage" type="box" size=".1 .1 .1" mass="3"/>
    </body>
  </worldbody>
  <actuator><motor name="motor" joint="carriage" gear="2"/></actuator>
</mujoco>
"""

PROBLEM = """
schema = 1
model = "carriage.xml"
measurements = ["carriage.csv"]
holdout = ["second"]

[parameters]
"body.carriage.mass" = [1.0, 10.0]
"joint.carriage.damping" = [0.0, 20.0]
"""


def table(seconds: float = 2.0) -> str:
    """Two runs at 100 Hz of m v' = 2 u - 2 v, m = 3, with u a sine; as a CSV table."""
    rows = ["run,time,ctrl.motor,qpos.carriage"]
    for run, phase in (("first", 0.0), ("second", 1.0)):
        q = v = 0.0
        for k in range(round(seconds * 100) + 1):
            u = 4 * math.sin(5 * k * 0.01 + phase)
            rows.append(f"{run},{k * 0.01:.2f},{u:.6f},{q:.6f}")
            for _ in range(2):
                v += 0.005 * (2 * u - 2 * v) / 3
                q += 0.005 * v
    return "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """carriage.xml, carriage.csv and carriage.toml in a folder of their own."""
    (tmp_path / "carriage.xml").write_text(MODEL)
    (tmp_path / "carriage.csv").write_text(table())
    (tmp_path / "carriage.toml").write_text(PROBLEM)
    return tmp_path
