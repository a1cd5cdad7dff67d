"""A run's recording and page: what was told is in the files, a run that goes on gets a second one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from rerun.chunk import RrdReader
from tensordict import TensorDict

from envs.pendulum import Pendulum
from onlinebayes.loggers import Curves, Page, RunRecorder, write_page
from onlinebayes.parameters import Parameter, ParameterSpace

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
    )
    write_page(page, tmp_path / "run.html")
    text = (tmp_path / "run.html").read_text("utf-8")
    assert "&lt;script&gt;" in text
    assert "a &amp; b" in text
    assert "narrowed to &lt; 5 %" in text
    assert "width:75.00%" in text
    assert text.count("<svg") == 1
    assert "data:image/png;base64," in text
    assert 'src="http' not in text
    assert "href" not in text.replace("xlink:href", "")
