"""refined.toml keeps the problem and adds the effects; refined.xml replays in plain MuJoCo as the simulator does."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import Criticism
from onlinebayes.criticism.results import WeightedModel
from onlinebayes.parameters import Parameter
from onlinebayes.report import left_out
from onlinebayes.report.html import to_html
from onlinebayes.report.json import to_dict
from onlinebayes.report.refined import write_refined
from onlinebayes.simulators.effects import ActuatorDeadZone, ActuatorDelay, Effect
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.report.synthetic import DRIVE, SPACE, changed, criticism, drive, miswired

PROBLEM = """
schema = 1
model = "models/drive.xml"
measurements = ["log.csv", "/elsewhere/more.csv"]
holdout = ["pulses"]
[parameters]
"body.carriage.mass" = [50.0, 150.0]
"joint.carriage.damping" = { low = 0.0, high = 1000.0 }
[signals."qpos.carriage"]
sd = 1e-5
[effects]
candidates = "all"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "drive.xml").write_text(DRIVE)
    (tmp_path / "log.csv").write_text("time,ctrl.motor,qpos.carriage\n")
    (tmp_path / "drive.toml").write_text(PROBLEM)
    return tmp_path


def test_the_problem_is_kept_and_the_effects_are_added(folder: Path) -> None:
    out = folder / "out" / "deep"
    write_refined(criticism(simulator=drive()), out, folder / "drive.toml")
    text = (out / "refined.toml").read_text()
    old, new = tomllib.loads(PROBLEM), tomllib.loads(text)
    assert new["effects"] == {"candidates": "all", "add": ["dry_friction@carriage", "constant_load@carriage"]}
    assert new["parameters"] == old["parameters"] | {
        "dry_friction@carriage.frictionloss": [0.0, 100.0], "constant_load@carriage.load": [-50.0, 50.0],
    }  # fmt: skip
    assert (new["schema"], new["holdout"], new["signals"]) == (1, ["pulses"], old["signals"])
    assert (out / new["model"]).resolve() == (folder / "models" / "drive.xml").resolve()
    assert (out / new["measurements"][0]).resolve() == (folder / "log.csv").resolve()
    assert new["measurements"][1] == "/elsewhere/more.csv"
    assert "# fitted: 95.1 ± 1.5 kg" in text


def test_the_problem_says_how_its_log_was_read(folder: Path) -> None:
    read = dataclasses.replace(criticism(simulator=drive()), read_as='commands_between_rows = "curve"')
    write_refined(read, folder / "out", folder / "drive.toml")
    assert tomllib.loads((folder / "out" / "refined.toml").read_text())["commands_between_rows"] == "curve"


def test_a_value_a_run_of_an_effect_stays_one(folder: Path) -> None:
    line = '"dry_friction@carriage.frictionloss" = { low = 0.0, high = 100.0, scope = "per_run" }'
    text = PROBLEM.replace("[signals", f"{line}\n[signals").replace('"all"', '"all"\nadd = ["dry_friction@carriage"]')
    (folder / "drive.toml").write_text(text)
    write_refined(criticism(simulator=drive()), folder / "out", folder / "drive.toml")
    new = tomllib.loads((folder / "out" / "refined.toml").read_text())["parameters"]
    assert new["dry_friction@carriage.frictionloss"] == {"low": 0.0, "high": 100.0, "scope": "per_run"}
    assert new["constant_load@carriage.load"] == [-50.0, 50.0]


def test_a_group_of_runs_keeps_its_globs_brackets(folder: Path) -> None:
    result = criticism(simulator=drive())
    value = result.final.parameters["body.carriage.mass"]
    names = ("run plain", "run r[0-2]", "run [ab]*")
    own = {f"body.carriage.mass[{name}]": value for name in names}
    result = dataclasses.replace(result, final=dataclasses.replace(result.final, parameters=own))
    write_refined(result, folder / "out", folder / "drive.toml")
    text = (folder / "out" / "refined.toml").read_text()
    assert f"# fitted: {'; '.join(f'{name} 95.1 ± 1.5 kg' for name in names)}" in text


def test_a_factory_stays_a_factory(folder: Path) -> None:
    (folder / "drive.toml").write_text(PROBLEM.replace("models/drive.xml", "my.package:build"))
    write_refined(criticism(simulator=drive()), folder / "out", folder / "drive.toml")
    assert tomllib.loads((folder / "out" / "refined.toml").read_text())["model"] == "my.package:build"


def test_refining_a_refined_problem_keeps_its_effects(folder: Path) -> None:
    result = criticism(simulator=drive())
    write_refined(result, folder / "one", folder / "drive.toml")
    write_refined(result, folder / "two", folder / "one" / "refined.toml")
    one, two = (tomllib.loads((folder / name / "refined.toml").read_text()) for name in ("one", "two"))
    assert two["effects"] == one["effects"]
    assert (folder / "two" / two["model"]).resolve() == (folder / "models" / "drive.xml").resolve()


def test_plain_mujoco_replays_the_refined_model_alike(folder: Path) -> None:
    result = criticism(simulator=drive())
    write_refined(result, folder / "out", folder / "drive.toml")
    model = mujoco.MjModel.from_xml_path(str(folder / "out" / "refined.xml"))
    command = 60 * np.sin(np.arange(2000) * 4e-3)
    data, plain = mujoco.MjData(model), np.empty(2000)
    for k, u in enumerate(command):
        data.ctrl[0] = u
        mujoco.mj_step(model, data)
        plain[k] = data.qpos[0]
    times = torch.arange(1, 2001, dtype=torch.float64) * 1e-3
    inputs = TensorDict({"command": torch.as_tensor(command)[None, :, None]}, batch_size=[1, 2000])
    state = TensorDict({"qpos": torch.zeros(1, 1), "qvel": torch.zeros(1, 1)}, batch_size=[1]).double()
    ours = result.final.simulator.rollout(result.final.theta[None], state, inputs, times)["qpos"][0, :, 0]
    assert np.abs(plain).max() > 0.01
    assert plain == pytest.approx(ours.numpy(), rel=0, abs=1e-12)


def test_meshes_are_found_from_the_new_folder(folder: Path) -> None:
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    (folder / "models" / "parts").mkdir()
    (folder / "models" / "parts" / "tetra.obj").write_text(corners)
    text = DRIVE.replace("<worldbody>", '<compiler meshdir="parts"/><asset><mesh file="tetra.obj"/></asset><worldbody>')
    text = text.replace('<geom name="rail"', '<geom type="mesh" mesh="tetra"/><geom name="rail"')
    (folder / "models" / "drive.xml").write_text(text)
    known = drive()
    simulator = MujocoSimulator(
        folder / "models" / "drive.xml", known.parameters.subspace(known.parameters.names[:2]), effects=known.effects
    )
    write_refined(criticism(simulator=simulator), folder / "out" / "deep", folder / "drive.toml")
    assert mujoco.MjModel.from_xml_path(str(folder / "out" / "deep" / "refined.xml")).nmesh == 1


def test_files_in_memory_are_written_beside_the_model(folder: Path) -> None:
    corners = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    text = DRIVE.replace("<worldbody>", '<asset><mesh file="tetra.obj"/></asset><worldbody>')
    text = text.replace('<geom name="rail"', '<geom type="mesh" mesh="tetra"/><geom name="rail"')
    spec = mujoco.MjSpec.from_string(text, assets={"tetra.obj": corners})
    known = drive()
    simulator = MujocoSimulator(spec, known.parameters.subspace(known.parameters.names[:2]), effects=known.effects)
    write_refined(criticism(simulator=simulator), folder / "out", folder / "drive.toml")
    assert (folder / "out" / "refined_assets" / "tetra.obj").read_bytes() == corners
    assert mujoco.MjModel.from_xml_path(str(folder / "out" / "refined.xml")).nmesh == 1


def with_one_more(effect: Effect, value: float) -> Criticism:
    """The result with one more accepted effect, of one parameter."""
    result, simulator = criticism(simulator=drive()), drive().with_effect(effect)
    theta = torch.cat([result.final.theta, torch.tensor([value], dtype=torch.float64)])
    effects = (*result.final.effects, effect.key)
    final = dataclasses.replace(
        result.final, simulator=simulator, theta=theta, covariance=torch.eye(5).double(), effects=effects
    )
    return dataclasses.replace(result, final=final, accepted=effects, given=drive())


def test_a_delay_that_mujoco_would_round_gives_the_file_another_timestep(folder: Path) -> None:
    result = with_one_more(ActuatorDelay("motor", Parameter(0.0, 0.02, "s")), 2e-4)
    assert left_out(result) == {}
    files = write_refined(result, folder / "out", folder / "drive.toml")
    assert files == ("refined.toml", "refined.xml", "refined_model.py")
    text = (folder / "out" / "refined.xml").read_text()
    assert "timestep 0.0002 s in place of 0.001 s, for MuJoCo has no delay shorter than one" in text.splitlines()[0]
    model = mujoco.MjModel.from_xml_string(text)
    assert (model.opt.timestep, model.actuator_delay[0]) == pytest.approx((2e-4, 2e-4))
    assert model.dof_frictionloss[0] == pytest.approx(22.04)
    assert "timestep=0.001" in (folder / "out" / "refined_model.py").read_text()


def test_what_mujoco_lacks_is_in_the_module_beside_the_file_and_both_errors_are_shown(folder: Path) -> None:
    result = with_one_more(ActuatorDeadZone("motor", Parameter(0.0, 20.0)), 5.0)
    signal = result.signals[0]
    result = dataclasses.replace(result, file_error={signal: 0.033})
    assert tuple(left_out(result)) == ("actuator_dead_zone@motor",)
    files = write_refined(result, folder / "out", folder / "drive.toml")
    comment = (folder / "out" / "refined.xml").read_text().splitlines()[0]
    assert "without actuator_dead_zone@motor, which plain MuJoCo has no term for" in comment
    assert "refined_model.py beside this file adds actuator_dead_zone@motor" in comment
    assert "DeadZone(width=5.0)" in (folder / "out" / "refined_model.py").read_text()
    assert to_dict(result)["refined_xml_error"] == {signal: 0.033}
    page = to_html(result, refined=files, left_out=left_out(result))
    assert "Held-out error of refined.xml by itself and of the whole model" in page
    assert "33 mm" in page


def test_the_comment_says_how_the_file_is_integrated_otherwise_than_the_users_model(folder: Path) -> None:
    result = dataclasses.replace(criticism(simulator=drive()), given=drive().with_timestep(0.002))
    write_refined(result, folder / "out", folder / "drive.toml")
    comment = (folder / "out" / "refined.xml").read_text().splitlines()[0]
    assert "fitted with timestep 0.001 s and integrator Implicitfast" in comment
    assert "the model's own, timestep 0.002 s and integrator Implicitfast, is too coarse" in comment


def test_there_is_no_xml_without_mujoco_and_no_toml_without_a_problem(folder: Path) -> None:
    assert write_refined(criticism(), folder / "a", folder / "drive.toml") == ("refined.toml",)
    assert write_refined(criticism(simulator=drive()), folder / "b") == ("refined.xml",)
    assert write_refined(criticism(), folder / "c") == ()


def test_what_differs_between_runs_is_per_run(folder: Path) -> None:
    out = folder / "out"
    write_refined(changed(criticism(simulator=drive())), out, folder / "drive.toml")
    new = tomllib.loads((out / "refined.toml").read_text())
    assert new["parameters"]["body.carriage.mass"] == {"low": 50.0, "high": 150.0, "scope": "per_run"}
    assert new["parameters"]["joint.carriage.damping"] == {"low": 0.0, "high": 1000.0}


def test_a_fault_is_put_right_in_the_refined_files(folder: Path) -> None:
    """The fit to the faulty table ends on a bound of 150 kg; nobody wants that model."""
    out = folder / "out"
    write_refined(miswired(), out, folder / "drive.toml")
    text = (out / "refined.toml").read_text()
    new = tomllib.loads(text)
    assert new["signals"]["qpos.carriage"] == {"sd": 1e-5, "sign": -1}
    assert new["holdout"] == ["pulses"]
    assert "# fitted: 95.0 ± 0.5 kg" in text
    assert "# refined.toml has the fault put right" in text
    written = (out / "refined.xml").read_text()
    assert "all accepted effects" not in written
    assert "fitted to the mended table (qpos.carriage: the reversed sign)" in written.splitlines()[0]
    assert mujoco.MjModel.from_xml_string(written).body("carriage").mass[0] == pytest.approx(95.0)


def test_a_fault_that_only_the_table_can_mend_leaves_the_problem_as_it_is(folder: Path) -> None:
    found = miswired()
    assert found.wiring is not None
    off = dataclasses.replace(found.wiring, lines="# in the table: a column enable.motor with 0 in every row of plain")
    write_refined(dataclasses.replace(found, wiring=off), folder / "out", folder / "drive.toml")
    text = (folder / "out" / "refined.toml").read_text()
    assert tomllib.loads(text)["signals"] == {"qpos.carriage": {"sd": 1e-5}}
    assert "# refined.toml reads the table with the fault" in text


def test_without_another_fit_the_files_say_that_theirs_is_of_the_faulty_table(folder: Path) -> None:
    write_refined(dataclasses.replace(miswired(), corrected=None), folder / "out", folder / "drive.toml")
    assert "hold the model fitted to the table with the fault" in (folder / "out" / "refined.toml").read_text()
    assert "fitted to the table with its fault" in (folder / "out" / "refined.xml").read_text().splitlines()[0]


def test_a_rival_has_a_problem_file_of_its_own(folder: Path) -> None:
    result = criticism(simulator=drive())
    friction = drive().effects[0]
    rival = MujocoSimulator(DRIVE, SPACE, threads=1, effects=(friction,)).with_free(
        "joint.carriage.armature", Parameter(0.0, 3.0, "kg")
    )
    names = ("body.carriage.mass", "dry_friction@carriage.frictionloss")
    model = dataclasses.replace(
        result.final,
        simulator=rival,
        effects=(friction.key,),
        parameters={name: result.final.parameters[name] for name in names},
    )
    hypotheses = (WeightedModel(0.6, result.accepted, result.final), WeightedModel(0.4, (friction.key,), model))
    written = write_refined(dataclasses.replace(result, hypotheses=hypotheses), folder / "out", folder / "drive.toml")
    assert written == ("refined.toml", "refined-2.toml", "refined.xml")
    text = (folder / "out" / "refined-2.toml").read_text()
    assert text.startswith("# Another model that the data leave open, believed to 40 %: with dry_friction@carriage\n")
    new = tomllib.loads(text)
    assert new["effects"]["add"] == ["dry_friction@carriage"]
    assert new["parameters"]["dry_friction@carriage.frictionloss"] == [0.0, 100.0]
    assert new["parameters"]["joint.carriage.armature"] == [0.0, 3.0]
    assert not any("constant_load" in name for name in new["parameters"])
