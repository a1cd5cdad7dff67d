"""The exported module for plain MuJoCo: values land where the library writes them, in scenes of one's own, too."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest

from onlinebayes.export import export
from onlinebayes.problems import load_worlds
from onlinebayes.simulators.mujoco.addresses import model_array
from tests.export.conftest import ARM, CORRELATION, MEAN, NAMES, PROBLEM, SD, alike, hypothesis, loaded, refined


@pytest.fixture
def module(folder: Path, tmp_path: Path) -> ModuleType:
    out = tmp_path / "out"
    assert export(folder, "mujoco", out) == ("worlds.json", "refined.xml", "worlds_mujoco.py")
    return loaded(out / "worlds_mujoco.py")


def read(model: mujoco.MjModel) -> list[float]:
    """The four parameters, read off a model."""
    return [
        float(model.body("fore").mass[0]),
        float(model.joint("shoulder").damping[0]),
        float(model.actuator("bend").gainprm[0]),
        float(model.joint("shoulder").frictionloss[0]),
    ]


@pytest.mark.parametrize("how", ["draws", "normal"])
def test_sampled_worlds_have_the_beliefs_mean_sd_and_correlation(module: ModuleType, how: str) -> None:
    rng = np.random.default_rng(0)
    worlds = np.array([read(module.sample_world(rng, how)) for _ in range(600)])
    if how == "draws":
        worlds = np.array([read(module.written(row)) for row in module.VALUES])
    alike(worlds, MEAN, SD, CORRELATION)


def test_values_land_where_the_library_writes_them(module: ModuleType, folder: Path) -> None:
    simulator = load_worlds(folder).worlds.simulator
    theta = module.DRAWS[:5]
    fields = simulator.fields(theta)
    assert {"body_mass", "dof_damping", "actuator_gainprm", "actuator_biasprm", "dof_frictionloss"} <= set(fields)
    for k in range(5):
        for model in (module.written(module.VALUES[k]), module.world(theta[k])):
            for field, values in fields.items():
                np.testing.assert_allclose(model_array(model, field), values[k], rtol=1e-9, atol=1e-12, err_msg=field)


def test_constants_follow_the_masses(module: ModuleType) -> None:
    model = module.written(module.VALUES[0])
    again = copy.copy(model)
    mujoco.mj_setConst(again, mujoco.MjData(again))
    np.testing.assert_array_equal(model.dof_invweight0, again.dof_invweight0)
    assert model.body_subtreemass[1] == pytest.approx(0.8 + float(module.DRAWS[0, 0]))


def test_a_scene_of_ones_own_is_written_by_names(module: ModuleType) -> None:
    box = '<body name="box"><joint name="slide" type="slide" damping="7"/><geom size="1" mass="5"/></body>'
    scene = mujoco.MjModel.from_xml_string(ARM.replace('<body name="upper">', f'{box}<body name="upper">'))
    world = module.sample_world(np.random.default_rng(1), model=scene)
    assert any(np.allclose(read(world), row) for row in module.DRAWS)
    assert (float(world.joint("slide").damping[0]), float(world.body("box").mass[0])) == (7.0, 5.0)
    assert float(scene.body("fore").mass[0]) == 0.4
    other = mujoco.MjModel.from_xml_string(ARM.replace('"fore"', '"hand"'))
    with pytest.raises(KeyError, match="no body 'fore'"):
        module.sample_world(np.random.default_rng(1), model=other)


def test_what_mujoco_lacks_is_never_left_out_in_silence(tmp_path: Path) -> None:
    effects = ["actuator_dead_zone@lift", "dry_friction@shoulder"]
    names = (*NAMES[:3], "actuator_dead_zone@lift.width", NAMES[3])
    mean, sd = (*MEAN[:3], 0.02, MEAN[3]), (*SD[:3], 0.001, SD[3])
    told = hypothesis(effects, names, mean, sd, np.eye(5).tolist())
    notes: list[str] = []
    export(refined(tmp_path / "refined", (effects, told)), "mujoco", tmp_path / "out", note=notes.append)
    assert any("actuator_dead_zone@lift is left out" in line for line in notes)
    module = loaded(tmp_path / "out" / "worlds_mujoco.py")
    with pytest.raises(NotImplementedError, match="actuator_dead_zone@lift"):
        module.sample_world(np.random.default_rng(0))
    world = module.sample_world(np.random.default_rng(0), without_left_out=True)
    assert any(np.allclose(read(world), row[[0, 1, 2, 4]]) for row in module.DRAWS)


def test_a_delay_is_mujocos_own(tmp_path: Path) -> None:
    told = hypothesis(
        ["actuator_delay@lift"], (*NAMES[:3], "actuator_delay@lift.delay"), (*MEAN[:3], 0.04), (*SD[:3], 0.004),
        np.eye(4).tolist(),
    )  # fmt: skip
    export(refined(tmp_path / "refined", (["actuator_delay@lift"], told)), "mujoco", tmp_path / "out")
    module = loaded(tmp_path / "out" / "worlds_mujoco.py")
    delays = [float(module.written(row).actuator_delay[0]) for row in module.VALUES]
    np.testing.assert_allclose(delays, module.DRAWS[:, 3])
    slow, quick = (module.written(module.VALUES[k]) for k in (int(np.argmax(delays)), int(np.argmin(delays))))
    begun = [first_motion(model) for model in (slow, quick)]
    assert begun[0] > begun[1] + 2
    steps = json.loads((tmp_path / "out" / "worlds.json").read_text())["actuators"]["delay_steps"]
    assert 5 <= steps["lift"]["min"] <= 8 <= steps["lift"]["max"] <= 11


def first_motion(model: mujoco.MjModel) -> int:
    """Steps until a command of 1 shows at the shoulder, with gravity off."""
    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    data.ctrl[0] = 1.0
    for k in range(100):
        mujoco.mj_step(model, data)
        if abs(data.qvel[0]) > 1e-6:
            return k
    return 100


def test_an_inertia_bends_and_only_its_draws_are_kept(tmp_path: Path) -> None:
    folder = tmp_path / "refined"
    names = (*NAMES[:3], "body.fore.inertial[1]")
    told = hypothesis((), names, (*MEAN[:3], 0.05), (*SD[:3], 0.02), np.eye(4).tolist())
    refined(folder, ((), told))
    problem = PROBLEM.replace('"body.fore.mass" = [0.1, 2.0]\n', "") + '"body.fore.inertial[1]" = [-0.5, 0.5]\n'
    told = hypothesis((), names[1:], (*MEAN[1:3], 0.05), (*SD[1:3], 0.02), np.eye(3).tolist())
    (folder / "refined.toml").write_text(problem)
    (folder / "report.json").write_text(json.dumps({"hypotheses": [told], "parameters": told["parameters"]}))
    export(folder, "mujoco", tmp_path / "out")
    module = loaded(tmp_path / "out" / "worlds_mujoco.py")
    fields = load_worlds(folder).worlds.simulator.fields(module.DRAWS[:3])
    for k in range(3):
        world = module.written(module.VALUES[k])
        for field in ("body_mass", "body_inertia", "body_ipos"):
            np.testing.assert_allclose(getattr(world, field), fields[field][k], rtol=1e-7, atol=1e-12, err_msg=field)
    with pytest.raises(NotImplementedError, match="bend with the parameters"):
        module.sample_world(np.random.default_rng(0), "normal")
