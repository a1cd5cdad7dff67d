"""Every script of ``recipes`` ends as a command does, and a recipe that imports no other one runs copied anywhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import envs
import onlinebayes
import recipes

FOLDER = Path(str(recipes.__file__)).parent
SCRIPTS = [path for path in sorted(FOLDER.rglob("*.py")) if "__main__" in path.read_text(encoding="utf-8")]
ALONE = [path for path in SCRIPTS if path.parent == FOLDER and "\nfrom recipes" not in path.read_text(encoding="utf-8")]
ASKED = """
import importlib, sys
from pathlib import Path
sys.modules["recipes"] = None  # which makes its import an error
for name in sys.argv[1:]:
    recipe = importlib.import_module(name)
    assert Path(recipe.__file__).parent == Path(__file__).parent, recipe.__file__
"""


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_every_script_ends_so(script: Path) -> None:
    end = script.read_text(encoding="utf-8").split('if __name__ == "__main__":\n')[1]
    assert end.strip().startswith(("sys.exit(status(", "sys.exit(main(", "sys.exit(experiments.main("))


@pytest.fixture
def installed(tmp_path: Path) -> dict[str, str]:
    """The environment of a machine on which ``onlinebayes`` and ``envs`` are installed and nothing else of ours is."""
    place = tmp_path / "installed"
    place.mkdir()
    for package in (onlinebayes, envs):
        folder = Path(str(package.__file__)).parent
        (place / folder.name).symlink_to(folder, target_is_directory=True)
    return os.environ | {"PYTHONPATH": str(place), "COLUMNS": "120"}


@pytest.mark.slow
def test_a_recipe_copied_out_says_how_it_is_used(tmp_path: Path, installed: dict[str, str]) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    copied = shutil.copy(FOLDER / "pendulum.py", empty)
    asked = [sys.executable, copied, "--help"]
    done = subprocess.run(asked, cwd=empty, env=installed, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "--noise" in done.stdout
    assert "--kind" in done.stdout
    assert [path.name for path in empty.iterdir()] == ["pendulum.py"], "help writes nothing"


@pytest.mark.slow
def test_recipes_that_import_no_other_one_are_imported_copied_out(tmp_path: Path, installed: dict[str, str]) -> None:
    assert {"acrobot", "cartpole", "custom_gym", "mountain_car", "own_simulator", "pendulum", "reach"} <= {
        path.stem for path in ALONE
    }
    empty = tmp_path / "empty"
    empty.mkdir()
    for path in ALONE:
        shutil.copy(path, empty)
    (empty / "asked.py").write_text(ASKED)
    asked = [sys.executable, "asked.py", *(path.stem for path in ALONE)]
    done = subprocess.run(asked, cwd=empty, env=installed, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
