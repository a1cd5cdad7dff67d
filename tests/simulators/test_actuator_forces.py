"""The actuators' forces along a known motion are those of the engine, before the gear."""

from __future__ import annotations

import mujoco
import pytest
import torch
from tensordict import TensorDict

from envs.cartpole import CartPole
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.simulators.systems import FREE

ARM = """<mujoco><worldbody><body name="upper"><joint name="shoulder" axis="0 1 0"/>
  <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.3" mass="1"/>
  <body name="fore" pos="0 0 -.3"><joint name="elbow" axis="0 1 0"/>
    <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.2" mass=".5"/><site name="hand" pos="0 0 -.2"/></body>
</body></worldbody><actuator>
  <position name="servo" joint="shoulder" kp="30" kv="2" gear="2" forcerange="-4 4"/>
  <motor name="motor" joint="elbow" gear="5"/>
  <general name="lever" site="hand" gear="1 0 0 0 0 0" gainprm="3"/>
</actuator></mujoco>"""


def motion(rows: int, joints: int, commands: int) -> TensorDict:
    generator = torch.Generator().manual_seed(0)
    drawn = torch.randn(2, rows, 2 * joints + commands, generator=generator, dtype=torch.float64)
    q, v, u = drawn.split([joints, joints, commands], dim=-1)
    return TensorDict({"qpos": q, "qvel": v, "command": u}, batch_size=(2, rows))


@pytest.fixture
def arm() -> MujocoSimulator:
    return MujocoSimulator(ARM, ParameterSpace({"actuator.servo.kp": Parameter(1.0, 100.0)}), threads=1)


def test_they_are_the_engines(arm: MujocoSimulator) -> None:
    moved, theta = motion(6, 2, 3), torch.tensor([[30.0], [12.0]], dtype=torch.float64)
    found = arm.actuator_forces(theta, moved, 0.002)
    limited = 0
    for n, kp in enumerate(theta[:, 0].tolist()):
        model = mujoco.MjModel.from_xml_string(ARM.replace('kp="30"', f'kp="{kp}"'))
        data = mujoco.MjData(model)
        for k in range(6):
            data.qpos, data.qvel, data.ctrl = (moved[key][n, k].numpy() for key in ("qpos", "qvel", "command"))
            mujoco.mj_forward(model, data)
            assert found[n, k].numpy() == pytest.approx(data.actuator_force, abs=1e-12)
            limited += abs(float(data.actuator_force[0])) == 4.0
    assert 0 < limited < 12


def test_an_actuator_that_is_off_gives_none(arm: MujocoSimulator) -> None:
    moved = motion(6, 2, 3)
    moved["enable"] = torch.tensor([0.0, 1.0, 0.0]).expand(2, 6, 3)
    found = arm.actuator_forces(arm.nominal[None].expand(2, -1), moved, 0.002)
    assert bool((found[..., [0, 2]] == 0).all())
    assert bool((found[..., 1] == moved["command"][..., 1]).all())


def test_a_late_command_gives_a_late_force(arm: MujocoSimulator) -> None:
    late = arm.with_effect(ActuatorDelay("motor", Parameter(0.0, 0.1)))
    theta = torch.tensor([[30.0, 0.004]], dtype=torch.float64).expand(2, -1)
    moved = motion(6, 2, 3)
    forces = late.actuator_forces(theta, moved, 0.002)[..., 1]
    torch.testing.assert_close(forces[:, 2:], moved["command"][:, :-2, 1])


def test_a_torch_systems_are_its_commands() -> None:
    simulator = CartPole(FREE)
    moved = motion(4, 2, 1)
    assert torch.equal(simulator.actuator_forces(simulator.nominal.expand(2, -1), moved, 0.01), moved["command"])
