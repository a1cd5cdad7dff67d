"""The exported event term in mjlab: an environment of several worlds, each one of the joint draws."""

from __future__ import annotations

import ast
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from onlinebayes.export import export

PYTHON = os.environ.get("ONLINEBAYES_MJLAB_PYTHON", "")


def test_the_module_is_python(folder: Path, tmp_path: Path) -> None:
    assert export(folder, "mjlab", tmp_path)[-1] == "worlds_mjlab.py"
    text = (tmp_path / "worlds_mjlab.py").read_text()
    assert "# joint.shoulder.damping: " in text
    defined = {node.name for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)}
    assert "joint_draws" in defined


@pytest.mark.skipif(not PYTHON, reason="mjlab asks for another MuJoCo: name its Python in ONLINEBAYES_MJLAB_PYTHON")
def test_every_world_is_one_of_the_joint_draws(folder: Path, tmp_path: Path) -> None:
    export(folder, "mjlab", tmp_path)
    program = [PYTHON, str(Path(__file__).parent / "mjlab_robot.py"), str(tmp_path)]
    printed = subprocess.run(program, capture_output=True, text=True, check=True, cwd=tmp_path).stdout
    found = json.loads(printed.splitlines()[-1])
    seen, draws = np.array(found["seen"]), np.array(json.loads((tmp_path / "worlds.json").read_text())["draws"])
    nearest = np.abs(seen[:, None] - draws[None]).max(2).min(1)
    assert nearest.max() < 1e-5
    assert len(np.unique(seen[:, 0])) > 8
    np.testing.assert_allclose(found["subtree"], 0.8 + seen[:, 0], rtol=1e-5)
