"""What is tried at position servos and their joints, and nowhere else unless it is named."""

import numpy as np
import pytest

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

ARM = """<mujoco><option timestep="0.005"/><worldbody><body><joint name="shoulder" axis="0 1 0" damping=".1"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass="1"/>
  <body pos="0 0 -.3"><joint name="elbow" axis="0 1 0" damping=".1"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".5"/></body>
</body></worldbody><actuator>
  <position name="holds" joint="shoulder" kp="30" kv="2"/><motor name="pushes" joint="elbow"/>
</actuator></mujoco>"""


@pytest.fixture
def log() -> tuple[MujocoSimulator, Windows]:
    simulator = MujocoSimulator(ARM, ParameterSpace({"actuator.holds.kp": Parameter(1.0, 100.0)}), threads=1)
    time = 0.01 * np.arange(400)
    shoulder, elbow = 0.4 * np.sin(5 * time), 0.4 * np.sin(3 * time + 1)
    columns = {"time": time, "ctrl.holds": shoulder, "ctrl.pushes": elbow}
    columns |= {"qpos.shoulder": shoulder, "qpos.elbow": elbow}
    signals = (Signal("qpos.shoulder", "rad", sd=1e-3), Signal("qpos.elbow", "rad", sd=1e-3))
    measurement = Measurement.from_runs({"run": columns}, signals, simulator.commands)
    return simulator, make_windows(simulator, measurement, 1.0)


def test_laws_of_servos_are_tried_at_servos(log: tuple[MujocoSimulator, Windows]) -> None:
    simulator, windows = log
    assert simulator.servos == {"shoulder": ("holds",)}
    tried = [effect.key for effect in propose(simulator, windows)]
    for name, place in (
        ("servo_law", "holds"),
        ("load_dependent_stribeck", "shoulder"),
        ("quadratic_load_friction", "shoulder"),
        ("backlash", "shoulder"),
    ):
        assert [key for key in tried if key.startswith(f"{name}@")] == [f"{name}@{place}"]
    assert {"load_dependent_friction@shoulder", "load_dependent_friction@elbow"} <= {*tried}


def test_they_are_tried_elsewhere_where_they_are_named(log: tuple[MujocoSimulator, Windows]) -> None:
    simulator, windows = log
    names = ["servo_law@pushes", "quadratic_load_friction@elbow"]
    assert [effect.key for effect in propose(simulator, windows, names)] == names
