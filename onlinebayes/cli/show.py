"""Open what a command wrote: the report in the browser, the recording in Rerun's viewer; say how where none can."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import webbrowser
from pathlib import Path

from onlinebayes.runs.errors import BadInput

REPORT, RECORDING = "report.html", "run.rrd"


def show(folder: str | Path) -> None:
    """Open ``report.html`` and ``run.rrd`` of a folder, or print where they are and how to open them.

    Raises:
        BadInput: the folder is not there or holds no report.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput("no such folder", "name the folder given to --out", where=str(folder))
    report, recording = folder / REPORT, folder / RECORDING
    if not report.is_file():
        raise BadInput(f"holds no {REPORT}", "name the folder given to --out", where=str(folder))
    screen = has_screen()
    opened = screen and _opened_in_browser(report)
    print(f"report:    {report.resolve()}{'' if opened else '   (open it in a browser)'}")
    if recording.is_file():
        viewer = shutil.which("rerun") or str(Path(sys.executable).with_name("rerun"))
        started = screen and _started([viewer, str(recording)])
        print(f"recording: {recording.resolve()}{'' if started else f'   (open it with: rerun {recording})'}")


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
