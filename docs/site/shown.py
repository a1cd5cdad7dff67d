"""Examples that the site shows, made anew: ``python docs/site/shown.py FOLDER``.

    FOLDER/shown/report/     what the README's first example leaves: report.html, report.json, run.rrd, refined.xml
    FOLDER/shown/run/        what a short run of recipes.cartpole leaves: run.html, run.rrd, log.csv, policy.md
    FOLDER/shown/stills.png  the stills of an episode on its page

What is there already is kept.
"""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
README_EXAMPLE = re.compile(r"^```python\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)
STILLS = re.compile(r'<img alt="[^"]*moments" src="data:image/png;base64,([^"]*)"')
RUN_FILES = ("run.html", "run.rrd", "log.csv", "policy.md")


def make_report(folder: Path) -> None:
    """Run the README's first example, which writes a report."""
    found = README_EXAMPLE.search((ROOT / "README.md").read_text(encoding="utf-8"))
    if found is None:
        raise SystemExit("README.md has no example")
    with TemporaryDirectory() as place:
        (Path(place) / "example.py").write_text(found[1], encoding="utf-8")
        subprocess.run([sys.executable, "example.py"], cwd=place, check=True, stdout=subprocess.DEVNULL)
        shutil.copytree(Path(place) / "out" / "arm", folder)


def make_run(folder: Path) -> None:
    """Train for a short time; keep what a reader opens."""
    with TemporaryDirectory() as place:
        command = [sys.executable, "-m", "recipes.cartpole", "--short", "--out", place]
        subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        (run,) = Path(place).iterdir()
        folder.mkdir(parents=True)
        for name in RUN_FILES:
            shutil.copy(run / name, folder / name)


def make_stills(page: Path, picture: Path) -> None:
    """Write the stills of an episode that stand in a run's page."""
    found = STILLS.search(page.read_text(encoding="utf-8"))
    if found is None:
        raise SystemExit(f"{page} has no stills")
    picture.write_bytes(base64.b64decode(found[1]))


def main(folder: str) -> None:
    """Make what is not there."""
    shown = Path(folder) / "shown"
    if not (shown / "report").exists():
        make_report(shown / "report")
    if not (shown / "run").exists():
        make_run(shown / "run")
    make_stills(shown / "run" / "run.html", shown / "stills.png")


if __name__ == "__main__":
    main(*sys.argv[1:])
