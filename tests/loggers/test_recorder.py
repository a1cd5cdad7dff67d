"""A run's recording and page: what was told is in the files, a run that goes on gets a second one."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning
from tensordict import TensorDict
from torchrl.record.loggers import CSVLogger

from envs.pendulum import Pendulum
from onlinebayes.loggers import Curves, Film, Page, RunRecorder, loggers_of, scalars, tensorboard, write_page
from onlinebayes.loggers.shapes import alike, archetype
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Shape
from tests.loggers.test_rerun import column, read

SPACE = ParameterSpace({"length": Parameter(0.1, 1.0, "m"), "mass": Parameter(0.1, 1.0, "kg")})
TRUTH = torch.tensor([0.5, 0.5], dtype=torch.float64)


class Belief:
    """Uniform between two thetas."""

    space = SPACE

    def __init__(self, low: float, high: float) -> None:
        self.low, self.high = low, high

    def sample(self, shape=(), generator=None):
        return self.low + (self.high - self.low) * torch.rand(*shape, 2, generator=generator, dtype=torch.float64)


def entities(path: Path) -> dict[str, int]:
    """Entity path -> rows, of a recording."""
    rows: dict[str, int] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if not chunk.is_static:
            rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.num_rows
    return rows


def recorded(folder: Path) -> Path:
    simulator = Pendulum(SPACE)
    angle = torch.linspace(0, 1, 40, dtype=torch.float64)[:, None]
    states = TensorDict({"qpos": angle, "qvel": angle}, (40,))
    recorder = RunRecorder(folder, "pendulum", SPACE, seconds=2.0, truth=TRUTH)
    for step in (1, 2):
        recorder.step(step, {"figures/return": -100.0 * step, "losses/actor": 0.1})
        recorder.belief(step, Belief(0.4, 0.6), Belief(0.2, 0.8))
        recorder.summary(step, f"# step {step}")
        recorder.picture(step, "corner", np.zeros((20, 30, 3), dtype=np.uint8))
        shapes, poses = simulator.shapes(TRUTH), simulator.poses(TRUTH, states)
        recorder.episode(step, "real", shapes, poses, 0.05)
        recorder.episode(step, "simulated", shapes, poses, 0.05, ghost=True)
    recorder.close()
    return recorder.path


def test_everything_that_was_told_is_in_the_recording(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    assert path.name == "run.rrd"
    rows = entities(path)
    for name in ("figures/return", "losses/actor", "belief/length/truth", "proposal/mass/low", "corner", "summary"):
        assert rows[f"/{name}"] == 2, name
    shape = next(shape.name for shape in Pendulum(SPACE).shapes(TRUTH) if shape.moving)
    for system in ("real", "simulated"):
        assert rows[f"/episodes/{system}/{shape}"] >= 2 * 40
    assert path.stat().st_size < 500_000


def test_a_run_that_goes_on_has_a_second_recording(tmp_path: Path) -> None:
    assert [recorded(tmp_path).name for _ in range(3)] == ["run.rrd", "run-2.rrd", "run-3.rrd"]


def test_a_finished_run_that_is_begun_again_gets_no_empty_recording(tmp_path: Path) -> None:
    recorded(tmp_path)
    RunRecorder(tmp_path, "pendulum", SPACE, seconds=2.0).close()
    assert [path.name for path in tmp_path.glob("*.rrd")] == ["run.rrd"]


def test_what_a_kill_cut_within_a_message_is_mended_by_the_run_that_goes_on(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    assert recorded(tmp_path).name == "run-2.rrd"
    with pytest.warns(RerunWarning, match="no footer"):
        rows = entities(path)
    assert rows["/belief/length/mean"] >= 1
    assert len(data) // 4 < path.stat().st_size <= len(data) // 2


def test_marginals_are_densities_of_the_draws(tmp_path: Path) -> None:
    found = read(recorded(tmp_path))
    edges, heights = (column(found["/marginals/mass/belief"], name) for name in ("widths", "values"))
    widths, density = np.array(edges[0]), np.array(heights[0][0]["buffer"])
    assert np.isclose((widths * density).sum(), 1.0, atol=1e-5)
    assert "/marginals/mass/proposal" in found


def test_pictures_thin_out_and_curves_do_not(tmp_path: Path) -> None:
    recorder = RunRecorder(tmp_path, "pendulum", SPACE, seconds=1.0, most=500_000)
    noise = np.random.default_rng(0).integers(0, 255, (60, 60, 3), dtype=np.uint8)
    for step in range(1, 201):
        recorder.step(step, {"losses/actor": 1.0})
        recorder.picture(step, "corner", noise)
        recorder.flush()
    recorder.close()
    rows = entities(recorder.path)
    assert rows["/losses/actor"] == 200
    assert 10 < rows["/corner"] < 150


def test_scalars_are_told_to_other_loggers(tmp_path: Path) -> None:
    logger = CSVLogger("csv", str(tmp_path))
    recorder = RunRecorder(tmp_path, "pendulum", SPACE, seconds=1.0, loggers=[logger])
    recorder.returns(3, {"online": -5.0, "oracle": -1.0})
    recorder.seconds(3, {"policy": 3.0, "fit": 1.0}, frames=800)
    recorder.close()
    told = {path.relative_to(tmp_path / "csv" / "scalars"): path.read_text() for path in tmp_path.rglob("*.csv")}
    assert told[Path("returns/oracle.csv")] == "3,-1.0\n"
    assert told[Path("speed/frames a second.csv")] == "3,200.0\n"


def test_calibration_is_a_picture(tmp_path: Path) -> None:
    recorder = RunRecorder(tmp_path, "pendulum", SPACE, seconds=1.0)
    recorder.calibration(1, [0.5, 0.9], [0.4, 0.95])
    recorder.close()
    assert entities(recorder.path)["/calibration"] == 1


def test_without_tensorboard_a_line_says_so(tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(scalars, "find_spec", lambda _name: None)
    assert tensorboard(tmp_path) == []
    assert capsys.readouterr().err.count("\n") == 1


def test_without_wandb_whoever_asks_for_it_is_told(monkeypatch) -> None:
    monkeypatch.setattr(scalars, "find_spec", lambda _name: None)
    with pytest.raises(BadInput, match=r"wandb is not installed; pip install 'onlinebayes\[wandb\]'"):
        loggers_of("wandb")
    assert loggers_of("tensorboard") is tensorboard
    with pytest.raises(BadInput, match="no logger is called 'csv'; known: tensorboard, wandb"):
        loggers_of("csv")


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("a file, not a folder")
    with pytest.raises(BadInput, match="cannot be written"):
        RunRecorder(tmp_path / "taken" / "run", "pendulum", SPACE, seconds=1.0).step(1, {"losses/actor": 1.0})


@pytest.mark.parametrize("ghost", [False, True])
def test_every_kind_of_shape_can_be_recorded(ghost: bool) -> None:
    corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    sizes = {"box": 3, "plane": 3, "ellipsoid": 3, "sphere": 1, "capsule": 2, "cylinder": 2}
    for kind, number in sizes.items():
        assert archetype(Shape("a", kind, (0.1,) * number, (1.0, 0.0, 0.0, 1.0)), ghost=ghost) is not None
    mesh = Shape("a", "mesh", (), (1.0, 0.0, 0.0, 1.0), vertices=corners, faces=torch.tensor([[0, 1, 2]]))
    assert archetype(mesh, ghost=ghost) is not None
    assert alike(mesh, Shape("b", "mesh", (), mesh.colour, vertices=corners.clone(), faces=mesh.faces))
    assert not alike(mesh, Shape("b", "mesh", (), mesh.colour, vertices=2 * corners, faces=mesh.faces))
    assert not alike(None, mesh)


def test_the_page_stands_alone_and_escapes_what_it_is_told(tmp_path: Path) -> None:
    curves = Curves(
        "return",
        ("frames", [1.0, 2.0, 3.0]),
        {"online": [0.0, math.nan, 2.0]},
        {"online": ([0, 0, 0], [1, 1, 1])},
        {"truth": 1.0},
    )
    page = Page(
        "<script>",
        "two steps",
        ["parameter", "mean"],
        [["a & b", "0.5"]],
        [curves],
        {"An episode": np.full((10, 10, 3), 200, dtype=np.uint8)},
        {"policy": 3.0, "fit": 1.0},
        ["narrowed to < 5 %"],
        {"A film": Film([np.full((10, 10, 3), k, dtype=np.uint8) for k in (0, 200)], 0.1)},
    )
    write_page(page, tmp_path / "run.html")
    text = (tmp_path / "run.html").read_text("utf-8")
    assert "&lt;script&gt;" in text
    assert "a &amp; b" in text
    assert "narrowed to &lt; 5 %" in text
    assert "width:75.00%" in text
    assert text.count("<svg") == 1
    assert "data:image/png;base64," in text
    assert "data:image/gif;base64," in text
    assert 'src="http' not in text
    assert "href" not in text.replace("xlink:href", "")


def test_a_full_disk_ends_the_run_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder = RunRecorder(tmp_path, "pendulum", SPACE, seconds=4.0)
    recorder.step(1, {"figures/return": 1.0})
    recorder.flush()
    full = shutil.disk_usage(tmp_path)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: full)
    recorder.step(2, {"figures/return": 2.0})
    with pytest.raises(BadInput, match=r"run.rrd: cannot be written: No space left on device; make room"):
        recorder.flush()
