"""A centre of mass that is moved is the one that a model file with that centre has."""

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ComOffset
from onlinebayes.simulators.mujoco import MujocoSimulator

FREE = """
<mujoco><option timestep="0.01"/><worldbody><body name="block"><freejoint name="pose"/>
  <geom name="block" type="box" size=".2 .15 .05" mass="2"/></body></worldbody></mujoco>"""
HINGED = """
<mujoco><option timestep="0.01"/><worldbody><body name="block"><joint name="pose" axis="0 1 0"/>
  <geom name="block" type="box" size=".2 .15 .05" mass="2"{}/></body></worldbody></mujoco>"""


def moved(text: str, offset: tuple[float, float, float]) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(text)
    body, compiled = spec.body("block"), spec.copy().compile()
    body.explicitinertial, body.mass = True, 2.0
    body.inertia, body.iquat = compiled.body("block").inertia, compiled.body("block").iquat
    body.ipos = compiled.body("block").ipos + np.array(offset)
    return spec.compile()


@pytest.mark.parametrize("text", [FREE, HINGED.format(""), HINGED.format(' pos="0 0 .3"')])
@pytest.mark.parametrize("by", ["effect", "parameter"])
def test_bodies_at_their_own_origin_have_a_centre_that_moves(text: str, by: str) -> None:
    offset = (0.01, 0.0, -0.02)
    model = moved(text, offset)
    data = mujoco.MjData(model)
    data.qvel[:] = 1.0
    if by == "effect":
        bounds = Parameter(-0.1, 0.1, "m")
        simulator = MujocoSimulator(text, effects=[ComOffset("block", bounds, bounds, bounds)], threads=1)
        theta = torch.tensor([offset], dtype=torch.float64)
    else:
        space = ParameterSpace({f"body.block.ipos[{k}]": Parameter(-1.0, 1.0, "m") for k in range(3)})
        simulator = MujocoSimulator(text, space, threads=1)
        theta = torch.from_numpy(model.body("block").ipos[None].copy())
    state = simulator.state.select("qpos", "qvel")
    state["qvel"] += 1.0
    inputs = TensorDict({"command": torch.zeros(1, 50, 0)}, batch_size=(1, 50))
    path = simulator.rollout(theta, state, inputs, 0.01 * torch.arange(1, 51, dtype=torch.float64))
    mujoco.mj_step(model, data, nstep=50)
    assert np.allclose(path["qpos"][0, -1], data.qpos, atol=1e-10)
    assert np.allclose(path["qvel"][0, -1], data.qvel, atol=1e-10)
    still = moved(text, (0.0, 0.0, 0.0))
    data = mujoco.MjData(still)
    data.qvel[:] = 1.0
    mujoco.mj_step(still, data, nstep=50)
    assert not np.allclose(path["qvel"][0, -1], data.qvel, atol=1e-3)


def test_a_geom_at_the_centre_of_mass_stays_where_it_is() -> None:
    text = HINGED.format(' pos="0 0 .3"')
    simulator = MujocoSimulator(text, effects=[ComOffset("block.x", Parameter(-0.1, 0.1, "m"))], threads=1)
    data = mujoco.MjData(simulator.model)
    simulator.model.body_ipos[1, 0] += 0.05
    mujoco.mj_forward(simulator.model, data)
    assert np.allclose(data.xipos[1], [0.05, 0, 0.3])
    assert np.allclose(data.geom_xpos[0], [0, 0, 0.3])
