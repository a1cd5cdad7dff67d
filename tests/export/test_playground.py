"""The exported module in MuJoCo Playground's place: batched models with correlated values, stepped by MJX."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from onlinebayes.export import export
from tests.export.conftest import ARM, CORRELATION, MEAN, SD, alike, hypothesis, loaded, refined

jax = pytest.importorskip("jax", reason="MuJoCo Playground's worlds need jax (pip install playground)")
mjx = pytest.importorskip("mujoco.mjx", reason="MuJoCo Playground's worlds need MJX (pip install playground)")


@pytest.fixture
def out(folder: Path, tmp_path: Path) -> Path:
    assert export(folder, "playground", tmp_path / "out")[-1] == "worlds_playground.py"
    return tmp_path / "out"


def values(model: Any, *, joint: int = 0, body: int = 2) -> np.ndarray:
    """The four parameters of every world (B, 4)."""
    parts = (model.body_mass[:, body], model.dof_damping[:, joint], model.actuator_gainprm[:, 1, 0])
    return np.stack([np.asarray(part) for part in (*parts, model.dof_frictionloss[:, joint])], 1)


def test_every_world_is_one_of_the_joint_draws(out: Path) -> None:
    module = loaded(out / "worlds_playground.py")
    model = mjx.put_model(mujoco.MjModel.from_xml_path(str(out / "refined.xml")))
    batch, axes = module.domain_randomize(model, jax.random.split(jax.random.PRNGKey(0), 512))
    alike(values(batch), MEAN, SD, CORRELATION)
    np.testing.assert_allclose(batch.actuator_biasprm[:, 1, 1], -batch.actuator_gainprm[:, 1, 0])
    np.testing.assert_allclose(batch.body_subtreemass[:, 1], 0.8 + batch.body_mass[:, 2], rtol=1e-5)
    assert (axes.body_mass, axes.dof_damping, axes.geom_friction) == (0, 0, None)
    step = jax.jit(jax.vmap(lambda one, u: mjx.step(one, mjx.make_data(one).replace(ctrl=u)).qvel, in_axes=(axes, 0)))
    moved = np.asarray(step(batch, jax.numpy.ones((512, 2))))
    assert np.isfinite(moved).all()
    assert moved[:, 0].std() > 0


def test_a_scene_of_ones_own_is_written_by_names(out: Path) -> None:
    module = loaded(out / "worlds_playground.py")
    box = '<body name="box"><joint name="slide" type="slide" damping="7"/><geom size="1" mass="5"/></body>'
    scene = ARM.replace('<body name="upper">', f'{box}<body name="upper">')
    model = mjx.put_model(mujoco.MjModel.from_xml_string(scene))
    batch, _ = module.domain_randomize(model, jax.random.split(jax.random.PRNGKey(0), 8))
    assert (np.asarray(batch.dof_damping[:, 0]) == 7).all()
    mass = np.asarray(values(batch, joint=1, body=3)[:, 0])
    assert np.abs(mass - MEAN[0]).max() < 5 * SD[0]


def test_what_mujoco_lacks_is_said(tmp_path: Path) -> None:
    names = ("body.fore.mass", "joint.shoulder.damping", "actuator.bend.kp", "actuator_dead_zone@lift.width")
    told = hypothesis(["actuator_dead_zone@lift"], names, (*MEAN[:3], 0.02), (*SD[:3], 0.001), np.eye(4).tolist())
    export(refined(tmp_path / "refined", (["actuator_dead_zone@lift"], told)), "playground", tmp_path / "out")
    module = loaded(tmp_path / "out" / "worlds_playground.py")
    model = mjx.put_model(mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "refined.xml")))
    with pytest.warns(UserWarning, match="actuator_dead_zone@lift"):
        module.domain_randomize(model, jax.random.split(jax.random.PRNGKey(0), 2))


def test_playgrounds_own_wrapper_takes_it(out: Path) -> None:
    playground = pytest.importorskip("mujoco_playground", reason="needs MuJoCo Playground (pip install playground)")
    wrapper = pytest.importorskip("mujoco_playground._src.wrapper")
    module = loaded(out / "worlds_playground.py")

    class Arm(playground.MjxEnv):
        def __init__(self) -> None:
            self._config = playground._src.mjx_env.config_dict.create(ctrl_dt=0.005, sim_dt=0.005)
            self._mj_model = mujoco.MjModel.from_xml_path(str(out / "refined.xml"))
            self._mjx_model = mjx.put_model(self._mj_model)

        def reset(self, rng: Any) -> Any:
            data = mjx.make_data(self._mjx_model)
            return playground.State(data, data.qpos, jax.numpy.zeros(()), jax.numpy.zeros(()), {}, {})

        def step(self, state: Any, action: Any) -> Any:
            data = mjx.step(self._mjx_model, state.data.replace(ctrl=action))
            return state.replace(data=data, obs=data.qpos)

        xml_path, action_size = property(lambda self: ""), property(lambda self: 2)
        mj_model, mjx_model = property(lambda self: self._mj_model), property(lambda self: self._mjx_model)

    keys = jax.random.split(jax.random.PRNGKey(0), 16)
    env = wrapper.BraxDomainRandomizationVmapWrapper(Arm(), lambda model: module.domain_randomize(model, keys))
    state = env.step(env.reset(keys), jax.numpy.ones((16, 2)))
    assert len(np.unique(np.asarray(state.data.qvel[:, 0]))) > 8
