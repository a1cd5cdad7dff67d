"""The whole road with free and ball joints: hidden truths are found, and nothing where there is nothing."""

import json
import tomllib
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch

from onlinebayes.cli.main import main
from onlinebayes.criticism import Criticism, Selection, refine
from onlinebayes.identification.data.chart import POSE as QPOS
from onlinebayes.identification.data.rotations import inverse, logarithm, product
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.identification.replaying.replay import rollout
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.report.geometry import measured_qpos, measured_turns
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.tumbling import BLOCK, FREE, NOISE, POSE, ROW, TRUTH, Block, fly, measure, model, table
from tests.identification.grounding import ground

OFFSET = 0.004
SIGNALS = (*POSE[:3], "qpos.pose.rx", "qpos.pose.ry", "qpos.pose.rz")
SHORT = Selection(horizon_s=0.5)
PENDULUM = """
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body name="bob">
  <joint name="gimbal" type="ball" damping="0.01"/><geom type="box" size=".05 .03 .02" pos="0 0 -.3" mass="1"/>
</body></worldbody></mujoco>"""


@pytest.fixture(scope="module")
def mended() -> Criticism:
    measured = measure(Block(centre=(OFFSET, 0.0, 0.0)), runs=9, seconds=1.0)
    return refine(model(), measured, holdout=["run7", "run8"], selection=SHORT, candidates=["com_offset"])


@pytest.mark.long
def test_a_hidden_offset_is_named_and_sized(mended: Criticism) -> None:
    assert mended.verdict == "missing_effect"
    assert mended.accepted == ("com_offset@block.x",)
    assert mended.signals == SIGNALS
    assert [mended.units[name] for name in SIGNALS] == ["m", "m", "m", "rad", "rad", "rad"]
    truths = dict(zip((*FREE, "com_offset@block.x.x"), (*TRUTH, OFFSET), strict=True))
    for name, truth in truths.items():
        estimate = mended.parameters[name]
        assert abs(estimate.mean - truth) < 3 * estimate.sd, name
        assert estimate.sd < 0.01 * truth
    assert max(mended.remainder.rms_over_floor.values()) < 1.1


@pytest.mark.slow
def test_the_recording_shows_the_measured_orientation(mended: Criticism) -> None:
    (run,) = [run for run in mended.final.replays if run.run == "run7"]
    _, poses, _ = fly(Block(centre=(OFFSET, 0.0, 0.0)), 9, 1.0, 0)
    simulator = mended.final.simulator.physics  # type: ignore[attr-defined]
    measured, qpos = run.measured.numpy(), run.qpos.numpy()
    drawn = measured_qpos(simulator.model, mended.signals, measured, qpos)
    drawn = measured_turns(simulator.model, mended.signals, measured - run.simulated.numpy(), drawn)
    true = torch.from_numpy(poses[7][np.rint(run.time.numpy() / ROW).astype(int)])
    away = logarithm(product(inverse(true[:, 3:]), torch.from_numpy(drawn[:, 3:])))
    assert float(away.abs().max()) < 5 * 2 * NOISE
    assert np.abs(drawn[:, :3] - true[:, :3].numpy()).max() < 5 * NOISE


@pytest.mark.long
def test_nothing_is_missing_where_nothing_is_hidden() -> None:
    measured = measure(Block(), runs=9, seconds=1.0, seed=5)
    found = refine(model(), measured, holdout=["run8"], selection=SHORT, candidates=["com_offset"])
    assert found.verdict == "adequate"
    assert found.accepted == ()
    for estimate, truth in zip(found.parameters.values(), TRUTH, strict=True):
        assert abs(estimate.mean - truth) < 3 * estimate.sd


def test_fitted_starts_are_the_true_ones() -> None:
    """Sharper than the smoothed ones: the model knows how the block goes on."""
    simulator, turned = charted(model(), measure(Block(), runs=4, seconds=2.0))
    grounds = ground(simulator, turned)
    windows, lin = grounds.windows, grounds.fitted.lin
    _, poses, _ = fly(Block(), 4, 2.0, 0)
    path = rollout(grounds.fitted.simulator, windows, grounds.fitted.theta[None], lin.starts[None])[0]
    rows = windows.first[:, None] + torch.arange(1, windows.rows + 1)
    true = torch.from_numpy(poses)[windows.run[:, None], (rows * windows.step / ROW).round().long()]
    away = logarithm(product(inverse(true[..., 3:]), path[QPOS][..., 3:]))
    inside = windows.inside
    assert float(away[inside].square().mean().sqrt()) < 0.5 * 2 * NOISE
    assert float((true[..., :3] - path[QPOS][..., :3])[inside].square().mean().sqrt()) < 0.5 * NOISE


@pytest.mark.slow
def test_the_damping_of_a_ball_joint_is_found() -> None:
    damping, draw = 0.03, np.random.default_rng(2)
    truth = mujoco.MjModel.from_xml_string(
        PENDULUM.replace("0.01", "0.001", 1).replace('damping="0.01"', 'damping="0.03"')
    )
    runs = {}
    for r in range(4):
        data = mujoco.MjData(truth)
        data.qvel[:] = draw.normal(0, 3, 3)
        path = []
        for _ in range(301):
            path.append(data.qpos.copy())
            mujoco.mj_step(truth, data, nstep=10)
        seen = np.array(path) + NOISE * draw.normal(size=(301, 4))
        runs[f"run{r}"] = {"time": ROW * np.arange(301), **{f"qpos.gimbal.{k}": seen[:, k] for k in range(4)}}
    simulator = MujocoSimulator(
        PENDULUM, ParameterSpace({"joint.gimbal.damping": Parameter(0.0, 0.5, "N m s/rad")}), threads=1
    )
    found = refine(simulator, Measurement.from_runs(runs, commands=[]), candidates=["payload", "gravity_tilt"])
    estimate = found.parameters["joint.gimbal.damping"]
    assert abs(estimate.mean - damping) < 3 * estimate.sd
    assert estimate.sd < 0.02 * damping
    assert found.accepted == ()
    assert max(found.remainder.rms_over_floor.values()) < 1.1


def problem(folder: Path, runs: dict[str, dict[str, np.ndarray]]) -> Path:
    """Model, table and problem file of the block in a folder."""
    lines = [",".join(["run", *next(iter(runs.values()))])]
    for run, columns in runs.items():
        lines += [",".join([run, *(f"{x:.9g}" for x in row)]) for row in zip(*columns.values(), strict=True)]
    (folder / "block.csv").write_text("\n".join(lines) + "\n")
    (folder / "block.xml").write_text(BLOCK)
    (folder / "block.toml").write_text(
        'schema = 1\nmodel = "block.xml"\nmeasurements = ["block.csv"]\n'
        '[parameters]\n"body.block.mass" = [1.0, 4.0]\n"body.block.inertia[0]" = [0.012, 0.029]\n'
        '[signals."qpos.pose.3"]\nsd = 1e-3\n'
    )
    return folder / "block.toml"


def test_next_refuses_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    toml = problem(tmp_path, table(Block(), runs=3, seconds=1.0))
    assert main(["next", str(toml), "--out", str(tmp_path / "out")]) == 2
    assert "joint 'pose' is a free or ball joint; only compare, diagnose and refine" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_first_problem_file_frees_the_mass_that_the_thruster_shows(tmp_path: Path) -> None:
    problem(tmp_path, table(Block(), runs=3, seconds=1.0))
    drafted = tmp_path / "drafted.toml"
    assert main(["init", str(tmp_path / "block.xml"), str(tmp_path / "block.csv"), "--out", str(drafted)]) == 0
    assert "body.block.mass" in tomllib.loads(drafted.read_text())["parameters"]
    assert "MISSING" not in drafted.read_text()


@pytest.mark.long
def test_a_table_with_quaternions_goes_through_refine(tmp_path: Path) -> None:
    toml, out = problem(tmp_path, table(Block(centre=(OFFSET, 0.0, 0.0)), runs=9)), tmp_path / "out"
    assert main(["refine", str(toml), "--out", str(out)]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["accepted"] == ["com_offset@block.x"]
    assert set(report["heldout_error"]["after"]) == set(SIGNALS)
    refined = mujoco.MjModel.from_xml_path(str(out / "refined.xml"))
    assert refined.body("block").ipos[0] == pytest.approx(OFFSET, rel=0.01)
    assert refined.body("block").mass[0] == pytest.approx(TRUTH[0], rel=0.01)
    assert main(["compare", str(out / "refined.toml"), "--out", str(tmp_path / "again")]) == 0
