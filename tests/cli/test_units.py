"""A log in degrees that is read in radians makes the replay diverge: the answer names the unit, and how to say it."""

from __future__ import annotations

from pathlib import Path

import pytest

from onlinebayes.cli.main import main
from tests.cli.drawn_problems import Drawn, Log, Machine

ARM = """<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody><body name="upper">
  <joint name="shoulder" axis="0 1 0" damping=".2"/><geom type="capsule" size=".03" fromto="0 0 0 0 0 -.4" mass="1"/>
  <body name="lower" pos="0 0 -.4"><joint name="elbow" axis="0 1 0" damping=".1"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass=".5"/></body></body></worldbody>
<actuator><position name="lift" joint="shoulder" kp="20" kv="1"/><position name="bend" joint="elbow" kp="10" kv=".5"/>
</actuator></mujoco>"""


def test_degrees_that_make_the_replay_diverge_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = Log(rows=(40, 40, 40), noise=1e-4, hidden={}, speeds=False, fault="degrees", seed=0)
    content = {"model": "model.xml", "measurements": ["log.csv"], "parameters": {}}
    drawn = Drawn(machine=Machine(xml=ARM, free={}, effects=(), drive=0.5), log=log, content=content)
    assert main(["compare", str(drawn.write(tmp_path)), "--out", str(tmp_path / "out")]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert "qpos.shoulder and qpos.elbow: degrees for radians" in last
    assert "scale = 0.0174532925 in [signals]" in last
    assert not (tmp_path / "out" / "report.json").exists()
