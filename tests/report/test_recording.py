"""run.rrd is read back: it is whole, thin, and holds what was measured and simulated."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
import pytest

from onlinebayes.report.arrows import places
from onlinebayes.report.geometry import bounds, log_shapes, measured_qpos, poses
from onlinebayes.report.recording import MOST_ROWS, rows, write_recording
from tests.loggers.test_rerun import column, read
from tests.report.synthetic import SIGNAL, criticism, drive


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rec") / "run.rrd"
    write_recording(criticism(simulator=drive()), path)
    return path


def test_rerun_verifies_it(recording: Path) -> None:
    rerun = Path(sys.executable).with_name("rerun")
    done = subprocess.run([rerun, "rrd", "verify", recording], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr


def test_curves_are_the_results_own(recording: Path) -> None:
    found, result = read(recording), criticism()
    before = next(replay for replay in result.base.replays if replay.run == "pulses")
    root = "/runs/pulses"
    measured = column(found[f"{root}/signals/{SIGNAL}/measured"], "scalars")
    assert np.ravel(measured) == pytest.approx(before.measured[:, 0].numpy())
    errors = np.ravel(column(found[f"{root}/errors/{SIGNAL}/before"], "scalars"))
    assert errors == pytest.approx(1e3 * (before.simulated - before.measured)[:, 0].numpy())
    times = column(found[f"{root}/signals/{SIGNAL}/after"], "time")
    assert times == pytest.approx(before.time.numpy())
    assert f"{root}/commands/motor" in found


def test_headline_and_ranking_are_documents(recording: Path) -> None:
    found = read(recording)
    ((report,),) = column(found["/report"], "text")
    assert "The model misses dry friction" in report
    ((ranking,),) = column(found["/ranking"], "text")
    assert "| 1 | dry friction at carriage | 212 ± 31 |" in ranking


def test_it_carries_a_layout(recording: Path) -> None:
    from rerun.chunk import RrdReader

    assert len(RrdReader(recording).blueprints()) == 1


def test_the_carriage_moves(recording: Path) -> None:
    found, result = read(recording), criticism()
    before = next(replay for replay in result.base.replays if replay.run == "pulses")
    keep = rows(before.time.numpy(), 50.0)
    for kind, expected in (("measured", before.measured), ("before", before.qpos)):
        moved = np.asarray(column(found[f"/runs/pulses/scene/{kind}/carriage"], "translation"))[:, 0]
        assert moved[:, 0] == pytest.approx(expected[keep, 0].numpy(), abs=1e-6)
        assert moved[:, 2] == pytest.approx(0.05)
    assert any(path.startswith("/runs/pulses/scene/measured/carriage/geom") for path in found)


def test_the_forces_of_the_effects_are_arrows_and_curves(recording: Path) -> None:
    found, result = read(recording), criticism()
    curve = np.ravel(column(found["/runs/pulses/forces/dry_friction\\@carriage"], "scalars"))
    friction = result.parameters["dry_friction@carriage.frictionloss"].mean
    assert np.abs(curve).max() == pytest.approx(friction)
    arrows = found["/runs/pulses/scene/forces/dry_friction\\@carriage"]
    vectors = np.asarray(column(arrows, "vectors"))[:, 0]
    assert np.abs(vectors[:, 1:]).max() == 0
    # The longest arrow is half as long as what is drawn is wide.
    low, high = bounds(drive().model, np.concatenate([r.qpos.numpy() for r in result.final.replays if r.held_out]))
    assert np.abs(vectors[:, 0]).max() == pytest.approx(0.5 * (high - low).max(), rel=0.05)
    labels = [label for (label,) in column(arrows, "labels")]
    assert "dry friction 22 N" in labels
    assert "dry friction -22 N" in labels


def test_a_hinge_has_its_arrow_across_the_arm() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body name="a"><joint name="h" axis="0 1 0"/>
        <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -1"/></body></worldbody></mujoco>"""
    )
    points, ways = places(model, 0, np.array([[0.0], [np.pi / 2]]))
    assert points == pytest.approx(np.array([[0, 0, -0.5], [-0.5, 0, 0]]), abs=1e-9)
    assert ways == pytest.approx(np.array([[-1, 0, 0], [0, 0, 1]]), abs=1e-9)


def test_a_simulator_without_geometry_has_no_scene(tmp_path: Path) -> None:
    write_recording(criticism(), tmp_path / "run.rrd")
    assert not [path for path in read(tmp_path / "run.rrd") if "scene" in path]


def test_odd_run_names_are_kept_apart(tmp_path: Path) -> None:
    import dataclasses

    result = criticism()
    replays = [dataclasses.replace(replay, run=f"a/b {k}") for k, replay in enumerate(result.base.replays)]
    base, final = (dataclasses.replace(model, replays=tuple(replays)) for model in (result.base, result.final))
    write_recording(dataclasses.replace(result, base=base, final=final), tmp_path / "run.rrd")
    runs = {path.split("/signals")[0] for path in read(tmp_path / "run.rrd") if "/signals" in path}
    assert len(runs) == 2


def test_long_logs_are_thinned() -> None:
    assert len(rows(np.arange(25_000) * 1e-3, 200.0)) == 5000
    assert len(rows(np.arange(100) * 0.01, 200.0)) == 100
    assert len(rows(np.arange(1_000_000) * 0.01, 200.0)) <= MOST_ROWS
    assert len(rows(np.zeros(1), 200.0)) == 1


def test_a_long_recording_is_quick_and_small(tmp_path: Path) -> None:
    result = criticism(rate=1000.0, seconds=12.0, simulator=drive())
    import rerun  # noqa: F401  (its import is not what is timed)

    start = time.perf_counter()
    write_recording(result, tmp_path / "run.rrd")
    assert time.perf_counter() - start < 3.0
    assert (tmp_path / "run.rrd").stat().st_size < 5e6


ARM = """<mujoco><worldbody><body name="a"><joint name="ball" type="ball"/><geom size="0.1"/>
<body name="b" pos="1 0 0"><joint name="hinge" axis="0 0 1"/><geom type="capsule" size="0.1 0.2"/></body></body>
</worldbody></mujoco>"""


def test_unmeasured_joints_follow_the_model() -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    simulated = np.tile([1.0, 0, 0, 0, 0.5], (3, 1))
    measured = np.array([[0.1, 0.0], [np.nan, 0.0], [0.3, 0.0]])
    qpos = measured_qpos(model, ("qpos.hinge", "qvel.hinge"), measured, simulated)
    assert qpos[:, 4] == pytest.approx([0.1, 0.2, 0.3])
    assert (qpos[:, :4] == simulated[:, :4]).all()
    qpos = measured_qpos(model, ("qpos.ball.1", "qpos.other"), measured, simulated)
    assert qpos[:, 1] == pytest.approx([0.1, 0.2, 0.3])


def test_poses_are_mujocos() -> None:
    model = mujoco.MjModel.from_xml_string(ARM)
    half = np.sqrt(0.5)
    positions, quaternions = poses(model, np.array([[half, 0, 0, half, 0.0]]))
    assert positions[0, 2] == pytest.approx([0, 1, 0], abs=1e-12)
    assert quaternions[0, 1] == pytest.approx([0, 0, half, half])


SHAPES = """
<mujoco>
  <asset><mesh name="t" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body name="a">
      <freejoint/>
      <geom type="box" size="1 1 1"/>
      <geom type="sphere" size="1"/>
      <geom type="ellipsoid" size="1 2 3"/>
      <geom type="cylinder" size="1 2"/>
      <geom type="capsule" size="1 2" pos="0 0 5"/>
      <geom type="mesh" mesh="t"/>
      <geom type="box" size="1 1 1" group="3"/>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("ghost", [None, (255, 140, 66, 255)])
def test_every_visible_shape_is_drawn(tmp_path: Path, ghost: tuple[int, int, int, int] | None) -> None:
    import rerun as rr

    model = mujoco.MjModel.from_xml_string(SHAPES)
    stream = rr.RecordingStream("shapes", send_properties=False)
    stream.save(tmp_path / "shapes.rrd")
    log_shapes(stream, "scene", model, ghost)
    stream.flush()
    stream.disconnect()
    found = read(tmp_path / "shapes.rrd")
    assert sorted(found) == [f"/scene/a/geom{geom}" for geom in range(1, 7)]
    # MuJoCo's capsule is centred on its position, Rerun's starts there.
    assert column(found["/scene/a/geom5"], "translations") == [[[0.0, 0.0, 3.0]]]


def test_the_view_holds_what_moves() -> None:
    low, high = bounds(drive().model, np.array([[-0.7], [0.2]]))
    assert low == pytest.approx([-0.78, -0.06, -0.01])
    assert high == pytest.approx([0.5, 0.06, 0.08])
    empty = mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>")
    assert np.isfinite(bounds(empty, np.zeros((3, 0)))).all()
