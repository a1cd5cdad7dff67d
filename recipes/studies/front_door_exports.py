"""What ``refine`` found, exported for every place where people train, and loaded back.

    a pendulum with hidden dry friction  ->  refine  ->  export --to TARGET  ->  draws in a model, or the module read

``json`` and ``mujoco`` are loaded here. The modules of the others need the package of that place; where it is missing
their text is compiled, and the row says so.
"""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import numpy as np

from onlinebayes.cli.main import main as command
from onlinebayes.export import TARGETS, export, files_of
from recipes.studies.front_door_times import FRICTION, many_rows

PACKAGES = {"playground": "mujoco.mjx", "mjlab": "mjlab", "isaaclab": "isaaclab"}
WITHIN = 0.1
"""Share of the truth by which the mean of the draws may differ."""


def refined(folder: Path) -> Path:
    """The folder that ``refine`` leaves for a pendulum with dry friction."""
    words = many_rows(folder, rows=10_000)
    assert command(["refine", words[1], "--out", str(folder / "refined")]) == 0
    return folder / "refined"


def loaded_back(folder: Path, target: str, out: Path) -> str:
    """Export and load; what was found, or an empty line where something is missing.

    Args:
        folder: that ``refine`` wrote to.
        target: one of the export's.
        out: folder for the files.
    """
    if set(export(folder, target, out)) != set(files_of(target)):
        return ""
    worlds = json.loads((out / "worlds.json").read_text(encoding="utf-8"))
    names, draws = list(worlds["parameters"]), np.array(worlds["draws"])
    friction = draws[:, [name.endswith("frictionloss") for name in names]]
    if friction.shape[1] != 1 or abs(friction.mean() / FRICTION - 1) > WITHIN:
        return ""
    if target == "json":
        return f"{len(draws)} draws"
    path = out / f"worlds_{target}.py"
    package = PACKAGES.get(target)
    if package is not None and not _is_here(package):
        compile(path.read_text(encoding="utf-8"), str(path), "exec")
        return f"compiled; {package} is not here"
    module = _imported(path)
    if target != "mujoco":
        return "imported"
    model = module.sample_world(np.random.default_rng(0))
    return "a world drawn" if abs(model.joint("hinge").frictionloss[0] / FRICTION - 1) < 2 * WITHIN else ""


def every_target(folder: Path, out: Path) -> dict[str, str]:
    """Target -> what :func:`loaded_back` found."""
    return {target: loaded_back(folder, target, out / target) for target in TARGETS}


def _is_here(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:
        return False


def _imported(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
