"""The wheel by itself: what it holds, and that its commands run in an environment in which no clone is in reach."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from tests.problems.conftest import MODEL, table

ROOT = Path(__file__).parents[1]
FOLDERS = ("onlinebayes", "envs", "recipes")
OURS = [path for name in FOLDERS[1:] for path in sorted((ROOT / name).rglob("*.py")) if "studies" not in path.parts]
ALONE = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
"""The variables of a process with nothing of the clone on its path."""
BUILT = ("setup.py", "pyproject.toml", "README.md", "LICENSE")


def renamed(text: str) -> str:
    """``setup.renamed``; the file is no module of a package."""
    spec = spec_from_file_location("setup_of_onlinebayes", ROOT / "setup.py")
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return str(module.renamed(text))


def imported(text: str) -> set[str]:
    """The top-level names that a module imports."""
    nodes = list(ast.walk(ast.parse(text)))
    plain = {alias.name.split(".")[0] for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {
        node.module.split(".")[0]
        for node in nodes
        if isinstance(node, ast.ImportFrom) and node.module and not node.level
    }


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("from envs.pendulum import Pendulum", "from onlinebayes.tasks.pendulum import Pendulum"),
        ("    from recipes import fetch_push", "    from onlinebayes.recipes import fetch_push"),
        ("import recipes.demo.run as run", "import onlinebayes.recipes.demo.run as run"),
        ("python -m recipes.pendulum --short", "python -m onlinebayes.recipes.pendulum --short"),
        (":class:`~envs.fetch.FetchTask`", ":class:`~onlinebayes.tasks.fetch.FetchTask`"),
        ('model = "envs.measured.dart_car:build"', 'model = "onlinebayes.tasks.measured.dart_car:build"'),
        ("from torchrl.envs import EnvBase", "from torchrl.envs import EnvBase"),
        ("import gymnasium.envs.mujoco", "import gymnasium.envs.mujoco"),
        ("the envs. And recipes, too", "the envs. And recipes, too"),
        ("onlinebayes.recipes.pendulum", "onlinebayes.recipes.pendulum"),
    ],
)
def test_names_of_the_repository_become_those_of_the_wheel(text: str, wanted: str) -> None:
    assert renamed(text) == wanted


def test_no_file_of_the_wheel_imports_a_name_of_the_repository_and_lines_stay_where_they_are() -> None:
    assert len(OURS) > 100
    for path in OURS:
        text = path.read_text(encoding="utf-8")
        done = renamed(text)
        assert not imported(done) & {"envs", "recipes"}, path
        assert len(done.splitlines()) == len(text.splitlines()), path


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel, built from a copy of the tree; nothing is fetched."""
    source = tmp_path_factory.mktemp("source")
    for name in FOLDERS:
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in BUILT:
        shutil.copy(ROOT / name, source)
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(source / "dist")]
    subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", *options, str(source)], check=True, env=ALONE)
    (built,) = (source / "dist").glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the programs of an environment that holds the wheel, and all else from this one's packages."""
    place = tmp_path_factory.mktemp("installed")
    venv.create(place, with_pip=False, symlinks=True)
    pip = [sys.executable, "-m", "pip", "--python", str(place), "install", "-q"]
    subprocess.run([*pip, "--no-deps", "--no-index", str(wheel)], check=True, env=ALONE)
    (packages,) = place.glob("lib/python*/site-packages")
    # A folder named in a .pth file has its own .pth files left alone: an editable install of the clone is out of reach.
    (packages / "dependencies.pth").write_text(sysconfig.get_paths()["purelib"])
    return place / "bin"


def ran(*command: str | Path, at: Path) -> str:
    """Run a command in an empty folder, with nothing of the clone on any path; returns what it printed."""
    done = subprocess.run(list(command), cwd=at, env=ALONE, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_wheel_takes_one_name_and_leaves_the_studies_behind(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0].split("-")[0] for name in names} == {"onlinebayes"}
    assert {"onlinebayes/py.typed", "onlinebayes/tasks/pendulum.py", "onlinebayes/recipes/pendulum.py"} <= set(names)
    models = {str(path.relative_to(ROOT / "envs")) for path in (ROOT / "envs").rglob("*.xml")}
    assert {f"onlinebayes/tasks/{model}" for model in models} <= set(names)
    assert not [name for name in names if name.startswith("onlinebayes/recipes/studies")]


@pytest.mark.slow
def test_the_library_comes_from_the_wheel_and_no_clone_is_in_reach(installed: Path, tmp_path: Path) -> None:
    asked = "from importlib.util import find_spec as f; print(f('onlinebayes').origin, f('envs'), f('recipes'))"
    file, *clone = ran(installed / "python", "-c", asked, at=tmp_path).split()
    assert installed.parent in Path(file).parents
    assert clone == ["None", "None"]
    version = ran(installed / "onlinebayes", "--version", at=tmp_path)
    assert version == ran(installed / "python", "-m", "onlinebayes", "--version", at=tmp_path)


@pytest.mark.slow
def test_a_model_and_a_log_are_refined(installed: Path, tmp_path: Path) -> None:
    (tmp_path / "carriage.xml").write_text(MODEL)
    (tmp_path / "carriage.csv").write_text(table())
    told = ran(installed / "onlinebayes", "refine", "carriage.xml", "carriage.csv", at=tmp_path)
    assert "wrote:     out/carriage-refine/problem.toml" in told
    assert "verdict:" in told
    wanted = {"problem.toml", "report.json", "report.html", "run.rrd", "refined.toml", "refined.xml"}
    assert wanted <= {path.name for path in (tmp_path / "out/carriage-refine").iterdir()}


@pytest.mark.slow
def test_the_demonstration_runs(installed: Path, tmp_path: Path) -> None:
    told = ran(installed / "onlinebayes", "demo", "--short", at=tmp_path)
    assert "actuator_delay@motor" in told
    assert "open it with: onlinebayes show out/demo" in told
    assert (tmp_path / "out/demo/demo.png").is_file()


@pytest.mark.slow
def test_a_recipe_runs_as_a_module_and_copied_out(installed: Path, tmp_path: Path) -> None:
    told = ran(installed / "python", "-m", "onlinebayes.recipes.own_simulator", "--short", at=tmp_path)
    assert "open it with: onlinebayes show out/own_simulator-0-short" in told
    assert "onlinebayes.recipes.pendulum" in ran(
        installed / "python", "-m", "onlinebayes.recipes.pendulum", "--help", at=tmp_path
    )
    (packages,) = installed.parent.glob("lib/python*/site-packages")
    shutil.copy(packages / "onlinebayes/recipes/pendulum.py", tmp_path / "mine.py")
    assert "--short" in ran(installed / "python", "mine.py", "--help", at=tmp_path)
