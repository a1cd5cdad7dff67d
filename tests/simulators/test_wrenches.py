"""A measured wrench as commands of the model: what MuJoCo's xfrc_applied does."""

from __future__ import annotations

import mujoco
import numpy as np
import torch
from tensordict import TensorDict

from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.wrenches import with_wrenches

MODEL = """
<mujoco><option timestep="0.002"/><worldbody>
  <body name="box" pos="0 0 2" euler="20 30 0"><freejoint name="free"/>
    <geom type="box" size=".1 .2 .3" pos=".1 .05 0"/></body>
  <body name="arm"><joint name="hinge" axis="0 1 0"/><geom type="capsule" size=".03" fromto="0 0 0 .5 0 0"/></body>
</worldbody><actuator><motor name="m" joint="hinge"/></actuator></mujoco>"""
WRENCH = {"xfrc.box.0": 3.0, "xfrc.box.2": 900.0, "xfrc.box.4": -2.0, "xfrc.box.5": 1.0, "xfrc.arm.2": 15.0}
STEPS = 100


def test_it_is_mujocos_own() -> None:
    spec = mujoco.MjSpec.from_string(MODEL)
    pushed = MujocoSimulator(with_wrenches(spec, [*WRENCH, "qpos.hinge", "meta.note"]), threads=1)
    assert sorted(pushed.commands) == sorted(("m", *WRENCH))
    assert pushed.targets("actuator") == ("m",)
    time = 0.002 * torch.arange(1, STEPS + 1, dtype=torch.float64)
    shape = torch.sin(20 * time)[:, None]
    size = torch.tensor([WRENCH.get(name, 0.5) for name in pushed.commands], dtype=torch.float64)
    start = torch.from_numpy(np.array(pushed.model.qpos0))
    state = TensorDict({"qpos": start[None], "qvel": torch.zeros(1, 7).double()}, batch_size=(1,))
    inputs = TensorDict({"command": (shape * size)[None]}, batch_size=(1, STEPS))
    found = pushed.rollout(torch.zeros(1, 0).double(), state, inputs, time)["qpos"][0].numpy()

    model = mujoco.MjModel.from_xml_string(MODEL)
    data, expected = mujoco.MjData(model), []
    for k in range(STEPS):
        data.ctrl[0] = 0.5 * float(shape[k])
        for name, value in WRENCH.items():
            _, body, axis = name.split(".")
            data.xfrc_applied[model.body(body).id, int(axis)] = value * float(shape[k])
        mujoco.mj_step(model, data)
        expected.append(data.qpos.copy())
    assert np.abs(found - np.array(expected)).max() < 1e-9
    assert np.abs(np.array(expected)[-1] - model.qpos0).max() > 0.05


def test_a_model_that_has_it_stays() -> None:
    """As refined.xml has, which is read with the same tables."""
    spec = with_wrenches(mujoco.MjSpec.from_string(MODEL), WRENCH)
    again = with_wrenches(spec, WRENCH)
    assert [a.name for a in again.actuators] == [a.name for a in spec.actuators]
