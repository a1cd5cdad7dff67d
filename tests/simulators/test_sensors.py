"""Sensors as signals: the numbers that plain MuJoCo gives at the same state, and nothing else changed by reading."""

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ConstantLoad
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_simulator

SWING = """
<mujoco><option timestep="0.002"/><worldbody><body>
  <joint name="swing" axis="0 1 0" damping=".1"/><geom size=".1" pos=".3 0 0" mass="1"/><site name="tip" pos=".3 0 0"/>
</body></worldbody><actuator><motor name="motor" joint="swing" gear="3"/></actuator>
<sensor><accelerometer name="felt" site="tip"/><jointpos name="angle" joint="swing"/></sensor></mujoco>"""
SENSORS = ("sensor.felt.0", "sensor.felt.2", "sensor.angle", "qfrc.swing")
SPACE = ParameterSpace({"joint.swing.damping": Parameter(0.0, 1.0)})
ROWS, PER_ROW = 20, 2


@pytest.fixture(scope="module")
def inputs() -> TensorDict:
    command = torch.randn(3, ROWS, 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    enable = torch.ones_like(command)
    enable[:, 12:] = 0
    return TensorDict({"command": command, "enable": enable}, batch_size=(3, ROWS))


def rolled(simulator: MujocoSimulator, inputs: TensorDict) -> TensorDict:
    theta = torch.tensor([[0.2], [0.0], [0.9]], dtype=torch.float64)
    still = torch.zeros(3, 1, dtype=torch.float64)
    state = TensorDict({"qpos": still + 0.3, "qvel": still}, batch_size=(3,))
    times = torch.arange(1, ROWS + 1, dtype=torch.float64) * PER_ROW * simulator.timestep
    return simulator.rollout(theta, state, inputs, times)


def test_a_rollout_reads_what_mujoco_computes_at_each_row(inputs) -> None:
    simulator = MujocoSimulator(SWING, SPACE, sensors=SENSORS)
    assert simulator.signals == ("qpos.swing", "qvel.swing", *SENSORS)
    inputs = inputs.select("command")
    read = simulator.read(rolled(simulator, inputs)).numpy()
    for world, damping in enumerate((0.2, 0.0, 0.9)):
        model = mujoco.MjModel.from_xml_string(SWING)
        model.dof_damping[:] = damping
        data, at = mujoco.MjData(model), mujoco.MjData(model)
        data.qpos[0] = 0.3
        command = inputs["command"][world, :, 0].tolist()
        for k in range(ROWS):
            data.ctrl[0] = command[k]
            for _ in range(PER_ROW):
                mujoco.mj_step(model, data)
            at.qpos[:], at.qvel[:], at.ctrl[0] = data.qpos, data.qvel, command[k]
            mujoco.mj_forward(model, at)
            wanted = [*data.qpos, *data.qvel, *at.sensordata[[0, 2, 3]], *at.qfrc_actuator]
            np.testing.assert_allclose(read[world, k], wanted, rtol=1e-12, atol=1e-14)


def test_reading_changes_nothing_and_an_actuator_that_is_off_gives_no_torque(inputs) -> None:
    with_sensors = rolled(MujocoSimulator(SWING, SPACE, sensors=SENSORS), inputs)
    without = rolled(MujocoSimulator(SWING, SPACE), inputs)
    for key in ("qpos", "qvel", "valid"):
        assert torch.equal(with_sensors[key], without[key])
    torque = with_sensors["sensor"][..., 3]
    assert bool((torque[:, 12:] == 0).all())
    assert bool((torque[:, :12] != 0).all())


def test_batched_equals_single_and_effects_keep_the_sensors(inputs) -> None:
    check_simulator(MujocoSimulator(SWING, SPACE, worlds=3, sensors=SENSORS))
    grown = MujocoSimulator(SWING, SPACE, sensors=SENSORS).with_effect(ConstantLoad("swing", Parameter(-1.0, 1.0)))
    assert grown.signals[2:] == SENSORS
    assert grown.with_timestep(0.001).with_worlds(2).signals == grown.signals


def test_every_other_form_of_the_simulator_keeps_the_sensors() -> None:
    simulator = MujocoSimulator(SWING, SPACE, sensors=SENSORS)
    wider = simulator.with_bounds("joint.swing.damping", Parameter(0.0, 2.0))
    for other in (wider, simulator.with_worlds(2), simulator.with_timestep(0.001), simulator.with_runge_kutta()):
        assert other.signals == simulator.signals


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ("sensor.felt", "no sensor signal 'sensor.felt'; nearest: sensor.felt"),
        ("sensor.heat", "no sensor signal 'sensor.heat'"),
        ("qfrc.swong", "no joint 'swong'; nearest: swing"),
    ],
)
def test_a_sensor_that_is_not_there(sensor, message) -> None:
    with pytest.raises(BadInput, match=message):
        MujocoSimulator(SWING, SPACE, sensors=(sensor,))


def test_the_first_reading_is_of_the_state_that_was_set() -> None:
    simulator = MujocoSimulator(SWING, sensors=("sensor.angle",))
    start = simulator.state
    start["qpos"][:] = 0.3
    assert float(simulator.with_worlds(1).reset(simulator.nominal[None], start)["sensor"]) == 0.3
