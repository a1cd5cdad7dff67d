"""What MuJoCo's compiler derives stays what it was when a fitted model is written and loaded again."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator

MODEL = """
<mujoco><compiler {compiler}/><worldbody>
<body name="a"><joint name="j1" axis="0 1 0" damping="0.1" {joint}/><geom size=".1" pos="0 0 -.3" mass="1"/>
<body name="b" pos="0 0 -.3"><joint name="j2" axis="0 1 0" damping=".05"/>{inertial}
<geom size=".05" pos="0 0 -.3" mass=".5"/></body></body></worldbody><actuator>{actuator}</actuator></mujoco>"""
MOTOR, SERVO = '<motor name="m1" joint="j1"/>', '<position name="m1" joint="j1" kp="10" {}/>'
OTHER = '<inertial pos="0 0 -.1" mass="3" diaginertia=".1 .1 .1"/>'


@pytest.mark.parametrize(
    ("parts", "address", "value"),
    [
        ({"compiler": 'settotalmass="3"'}, "body.b.mass", 0.7),
        ({"compiler": 'boundmass="0.9" boundinertia="0.01"'}, "body.b.mass", 0.7),
        ({"compiler": 'inertiafromgeom="true"', "inertial": OTHER}, "body.a.mass", 0.7),
        ({"joint": 'stiffness="2" springdamper="0.5 1"'}, "joint.j1.damping", 0.3),
        ({"joint": 'springdamper="0.5 1"'}, "body.b.mass", 0.7),
        ({"joint": 'range="-30 30"', "actuator": SERVO.format('inheritrange="1"')}, "joint.j1.range[1]", 0.3),
        ({"actuator": SERVO.format('dampratio="1"')}, "body.b.mass", 0.7),
        ({"joint": 'range="-30 30"', "actuator": '<muscle name="m1" joint="j1"/>'}, "joint.j1.range[1]", 0.3),
    ],
)
@pytest.mark.filterwarnings("ignore:compiler attribute")
def test_the_file_replays_alike(parts: dict[str, str], address: str, value: float) -> None:
    text = MODEL.format(**{"compiler": "", "joint": "", "inertial": "", "actuator": MOTOR} | parts)
    simulator = MujocoSimulator(text, ParameterSpace({address: Parameter(0.0, 1.0)}))
    theta = torch.tensor([value], dtype=torch.float64)
    model = mujoco.MjModel.from_xml_string(simulator.export_xml(theta))
    data, command, path = mujoco.MjData(model), 3 * np.sin(0.05 * np.arange(200)), []
    for u in command:
        data.ctrl[0] = u
        mujoco.mj_step(model, data)
        path.append(data.qpos.copy())
    times = simulator.timestep * torch.arange(1, 201, dtype=torch.float64)
    inputs = TensorDict({"command": torch.as_tensor(command)[None, :, None]}, batch_size=[1, 200])
    ours = simulator.rollout(theta[None], simulator.state, inputs, times)["qpos"][0].numpy()
    assert np.abs(ours).max() > 1e-3
    assert np.abs(ours - path).max() < 1e-12


@pytest.mark.parametrize("address", ["joint.j1.range[1]", "actuator.m1.forcerange[0]", "actuator.m1.ctrlrange[1]"])
def test_a_limit_that_is_off_is_no_parameter(address: str) -> None:
    text = MODEL.format(compiler="", joint="", inertial="", actuator=MOTOR)
    with pytest.raises(BadInput, match=r"has no such limit; give the (joint|actuator) one in the model, .*range="):
        MujocoSimulator(text, ParameterSpace({address: Parameter(0.0, 1.0)}))
