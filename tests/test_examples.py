"""The pages of ``docs/examples`` run as a reader would run them, and print what they say they print."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
import torch

from tests.test_tutorial import blocks, shown_in

PAGES = sorted((Path(__file__).parents[1] / "docs" / "examples").glob("*.md"))


LONG = {
    "adaptive-policy",
    "from-log-to-policy",
    "ray",
    "recurrent-policy",
    "task-for-your-mjcf",
}  # train a policy or start workers, for a quarter of a minute
CASES = [pytest.param(page, id=page.stem, marks=pytest.mark.slow if page.stem in LONG else ()) for page in PAGES]


CENTRE = """
import torch
from tensordict import TensorDict
from torchrl.data import Bounded

from onlinebayes.simulators import Task


class Centre(Task):
    observation_size, horizon, action_spec = 2, 100, Bounded(-1, 1, (1,), dtype=torch.float32)

    def start(self, theta, generator):
        q = 2 * torch.rand(len(theta), 1, generator=generator, dtype=theta.dtype) - 1
        return TensorDict({"qpos": q, "qvel": 0 * q}, batch_size=[len(theta)])

    def observe(self, state):
        return torch.cat([state["qpos"], state["qvel"]], dim=-1).float()

    def command(self, action):
        return action

    def reward(self, state, action, after):
        return 1 - after["qpos"].abs().squeeze(-1)

    def terminated(self, state):
        return state["qpos"].abs().squeeze(-1) > 3
"""


def cart(folder: Path) -> None:
    """A cart whose motor does nothing for small commands, which its model does not know; 50 rows a second."""
    (folder / "cart.xml").write_text(
        '<mujoco><option timestep="0.002"/><worldbody><body name="cart"><joint name="rail" type="slide" axis="1 0 0" '
        'damping="2"/><geom size=".1" mass="3"/></body></worldbody>'
        '<actuator><motor name="motor" joint="rail" gear="6"/></actuator></mujoco>'
    )
    (folder / "cart.toml").write_text(
        'model = "cart.xml"\nmeasurements = ["cart.csv"]\n[parameters]\n"joint.rail.damping" = [0.0, 20.0]\n'
        '[effects]\ncandidates = ["actuator_dead_zone", "dry_friction", "constant_load"]\n'
    )
    rows, noise = ["run,time,ctrl.motor,qpos.rail"], torch.Generator().manual_seed(0)
    for run in range(6):
        q = v = 0.0
        for k in range(300):
            u = math.sin(0.02 * k * (3 + run)) + 0.3 * math.sin(0.2 * k)
            read = q + 1e-4 * float(torch.randn((), generator=noise))
            rows.append(f"{run},{0.02 * k:.2f},{u:.6f},{read:.6f}")
            for _ in range(10):
                v += 0.002 * (6 * math.copysign(max(abs(u) - 0.3, 0.0), u) - 3 * v) / 3
                q += 0.002 * v
    (folder / "cart.csv").write_text("\n".join(rows) + "\n")
    (folder / "centre.py").write_text(CENTRE)


LOGS = {"from-log-to-policy": cart}
"""Pages that begin with a reader's own files, and what writes some."""


NEEDS = {"policy-in-use": ("safetensors",)}
"""Packages that a page needs."""


@pytest.mark.parametrize("page", CASES)
def test_the_page_does_what_it_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for package in NEEDS.get(page.stem, ()):
        pytest.importorskip(package)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    LOGS.get(page.stem, lambda _folder: None)(tmp_path)
    names: dict[str, object] = {"__name__": page.stem.replace("-", "_")}
    told = 0
    for language, text in blocks(page.read_text(encoding="utf-8")):
        if language == "python":
            capsys.readouterr()
            exec(compile(text, page.name, "exec"), names)
        elif language == "text":
            shown_in(text, capsys.readouterr().out)
            told += 1
    assert told, "the page shows nothing that its code prints"


@pytest.mark.slow
def test_the_notebook_finds_what_its_machine_hides(capsys: pytest.CaptureFixture[str]) -> None:
    """The cells run as Python; in a Jupyter kernel ``make site`` runs them."""
    notebook = json.loads((PAGES[0].parent / "notebook.ipynb").read_text(encoding="utf-8"))
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert not any(cell.get("outputs") for cell in notebook["cells"]), "outputs are not kept in the file"
    names: dict[str, object] = {"__name__": "notebook"}
    exec(compile("\n".join(cells), "notebook.ipynb", "exec"), names)
    assert "missing_effect ('dry_friction@arm',)" in capsys.readouterr().out
    plt.close("all")


def test_the_way_from_a_log_to_a_policy_is_one_short_page() -> None:
    assert len((PAGES[0].parent / "from-log-to-policy.md").read_text(encoding="utf-8").splitlines()) <= 40


def test_there_are_pages() -> None:
    assert len(PAGES) >= 5
    for page in PAGES:
        assert re.match(r"# \S", page.read_text(encoding="utf-8")), page.name
