"""Open what a command or a training run wrote: the page in the browser, the recording in Rerun's viewer.

Where no window can be opened, it says where they are and how to open them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import webbrowser
from pathlib import Path

from onlinebayes.runs.errors import BadInput

PAGES = {"report.html": "report", "run.html": "page"}
"""Of criticism, and of a training run."""
RECORDINGS = "run*.rrd"
"""A training run that went on after a stop has several; the viewer shows them as one."""


def show(folder: str | Path) -> None:
    """Open the page and the recordings of a folder, or print where they are and how to open them.

    Raises:
        BadInput: the folder is not there or holds neither a report nor a run.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput("no such folder", "name the folder given to --out, or a run's", where=str(folder))
    found = [(name, folder / name) for name in PAGES if (folder / name).is_file()]
    if not found:
        raise BadInput(
            f"holds no {' and no '.join(PAGES)}", "name the folder given to --out, or a run's", where=str(folder)
        )
    screen = has_screen()
    for name, page in found:
        opened = screen and _opened_in_browser(page)
        print(f"{PAGES[name] + ':':<10} {page.resolve()}{'' if opened else '   (open it in a browser)'}")
    recordings = [str(path) for path in sorted(folder.glob(RECORDINGS), key=lambda path: (len(path.name), path.name))]
    if recordings:
        viewer = shutil.which("rerun") or str(Path(sys.executable).with_name("rerun"))
        started = screen and _started([viewer, *recordings])
        where = ", ".join(str(Path(path).resolve()) for path in recordings)
        print(f"recording: {where}{'' if started else f'   (open it with: rerun {chr(32).join(recordings)})'}")


def has_screen() -> bool:
    """Whether a window can be opened here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _opened_in_browser(report: Path) -> bool:
    try:
        return webbrowser.open(report.resolve().as_uri())
    except (OSError, webbrowser.Error):
        return False


def _started(command: list[str]) -> bool:
    try:
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    except OSError:
        return False
    return True
