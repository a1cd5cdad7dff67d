"""Ten numbers of any size are a body: what they do to it is exact, and plain MuJoCo replays what is exported."""

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.addresses import written_out

LINK = """<mujoco>
  <worldbody>
    <body name="base">
      <joint name="turn" axis="0 0 1"/>
      <geom type="box" size="0.1 0.05 0.02" pos="0.1 0 0" euler="10 20 30" mass="0.5"/>
      <body name="thrown" pos="0.3 0 0">
        <joint name="swing" axis="0 1 0"/>
        <geom type="box" size="0.1 0.05 0.02" mass="2"/>
        <site name="tip" pos="0 0 0"/>
      </body>
    </body>
  </worldbody>
  <sensor><accelerometer name="acceleration" site="tip"/></sensor>
  <actuator><motor name="motor" joint="turn"/></actuator>
</mujoco>"""
NAMES = tuple(f"body.thrown.inertial[{k}]" for k in range(10))


def simulator(xml: str = LINK, names: tuple[str, ...] = NAMES) -> MujocoSimulator:
    return MujocoSimulator(xml, ParameterSpace({name: Parameter(-1.0, 1.0) for name in names}))


def second_moments(fields: dict[str, np.ndarray], world: int, body: int) -> np.ndarray:
    """J of one world, put together again from MuJoCo's fields."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, fields["body_iquat"][world, body])
    R, moments = R.reshape(3, 3), fields["body_inertia"][world, body]
    m, c = fields["body_mass"][world, body], fields["body_ipos"][world, body]
    top = R @ np.diag(moments.sum() / 2 - moments) @ R.T + m * np.outer(c, c)
    return np.block([[top, m * c[:, None]], [m * c[None], np.array([[m]])]])


def test_a_body_in_the_model_stays_what_it_is() -> None:
    sim = simulator()
    assert sim.nominal.tolist() == [0.0] * 10
    fields = sim.fields(np.zeros((1, 10)))
    for name in ("body_mass", "body_ipos", "body_iquat", "body_inertia"):
        assert np.array_equal(fields[name][0], getattr(MujocoSimulator(LINK).model, name))


def test_any_ten_numbers_are_a_body_with_their_own_second_moments() -> None:
    phi = torch.empty(200, 10, dtype=torch.float64).uniform_(-1, 1, generator=torch.Generator().manual_seed(0)).numpy()
    sim = simulator()
    fields = sim.fields(phi)
    own = second_moments(sim.fields(np.zeros((1, 10))), 0, 2)
    U = np.linalg.cholesky(own[::-1, ::-1])[::-1, ::-1]
    for world in range(200):
        a, d, (s12, s23, s13), t = phi[world, 0], phi[world, 1:4], phi[world, 4:7], phi[world, 7:]
        V = np.diag([*np.exp(d), 1.0])
        V[0, 1], V[1, 2], V[0, 2], V[:3, 3] = s12, s23, s13, t
        wanted = np.exp(2 * a) * U @ V @ V.T @ U.T
        np.testing.assert_allclose(second_moments(fields, world, 2), wanted, rtol=1e-9, atol=1e-12)
        moments = np.sort(fields["body_inertia"][world, 2])
        assert moments[0] > 0
        assert moments[0] + moments[1] > moments[2], "a body's moments obey the triangle inequality"
    np.testing.assert_array_equal(fields["body_mass"][:, 1], np.full(200, sim.model.body_mass[1]))


def test_a_scaled_body_moves_as_one_whose_mass_and_moments_were_written() -> None:
    heavier = LINK.replace('mass="2"', f'mass="{2 * np.exp(0.4):.17g}"')
    theta = torch.zeros(1, 10, dtype=torch.float64)
    theta[0, 0] = 0.2
    torch.testing.assert_close(swung(simulator(), theta), swung(simulator(heavier), 0 * theta), atol=1e-10, rtol=0.0)


def test_worlds_replay_as_their_exported_models_do_in_plain_mujoco() -> None:
    """Also the turn of the principal axes, which compiled shortcuts would hide."""
    sim = simulator()
    theta = torch.empty(3, 10, dtype=torch.float64).uniform_(-0.3, 0.3, generator=torch.Generator().manual_seed(1))
    batch = swung(sim, theta)
    for world in range(3):
        model = mujoco.MjModel.from_xml_string(sim.export_xml(theta[world]))
        data = mujoco.MjData(model)
        data.qpos[:], data.qvel[:] = [0.1, 0.5], [2.0, -1.0]
        data.ctrl[:] = 0.3
        for k in range(200):
            mujoco.mj_step(model, data)
            np.testing.assert_allclose(batch[world, k].numpy(), [*data.qpos, *data.qvel], atol=1e-9)
    assert float((batch[0, -1] - batch[1, -1]).abs().max()) > 1e-3


def swung(sim: MujocoSimulator, theta: torch.Tensor) -> torch.Tensor:
    M, K = len(theta), 200
    start = {"qpos": torch.tensor([[0.1, 0.5]]), "qvel": torch.tensor([[2.0, -1.0]])}
    state = TensorDict({k: v.double().expand(M, 2) for k, v in start.items()}, batch_size=(M,))
    inputs = TensorDict({"command": torch.full((M, K, 1), 0.3, dtype=torch.float64)}, batch_size=(M, K))
    path = sim.rollout(theta, state, inputs, torch.arange(1, K + 1, dtype=torch.float64) * sim.timestep)
    return torch.cat([path["qpos"], path["qvel"]], -1)


def test_without_an_index_all_ten_are_meant() -> None:
    assert written_out(simulator().model, "body.thrown.inertial") == NAMES
    assert len(written_out(simulator().model, "body.*.inertial")) == 20
    assert written_out(simulator().model, "body.thrown.mass") == ("body.thrown.mass",)


def test_parameters_of_more_joints_than_there_are_bodies_stand_beside_it() -> None:
    joints = "".join(f'<joint name="{axis}" type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
    xml = f'<mujoco><worldbody><body name="block">{joints}<geom size="0.1" mass="1"/></body></worldbody></mujoco>'
    names = ("joint.0 0 1.damping", "body.block.inertial[0]")
    assert simulator(xml, names).fields(np.array([[0.5, 0.0]]))["dof_damping"][0, 2] == 0.5


def test_what_cannot_be_says_so() -> None:
    with pytest.raises(BadInput, match="the same body's inertia"):
        simulator(names=(NAMES[0], "body.thrown.mass"))
    with pytest.raises(BadInput, match="from 0 to 9"):
        simulator(names=("body.thrown.inertial[10]",))
    flat = '<inertial pos="0 0 0" mass="2" diaginertia="0.01 0.01 0.02"/>'
    disc = LINK.replace('<geom type="box" size="0.1 0.05 0.02" mass="2"/>', flat)
    with pytest.raises(BadInput, match="a point, a line or a plane"):
        simulator(disc)
