"""Open what a command or a training run wrote: the page in the browser, the recording in Rerun's viewer.

Where no window can be opened, it says where they are and how to open them.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import webbrowser
from pathlib import Path

from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.recordings import copy_whole, whole_bytes

PAGES = {"report.html": "report", "posterior.html": "posterior", "next.html": "plan", "run.html": "page"}
"""Of criticism, of a posterior, of a recording to make, and of a training run."""
RECORDINGS = "run*.rrd"
"""A training run that went on after a stop has several; the viewer shows them as one."""
CONTENTS = {
    "run.json": "recipe and settings",
    "log.csv": "one row a step",
    "seeds.csv": "medians and quartiles over seeds, one row a step",
    "tensorboard": "the same curves for TensorBoard",
    "checkpoint-*": "all that the run needs to go on",
    "report.json": "all figures of the report",
    "posterior.json": "all figures of the posterior",
    "belief*.json": "the distribution, to draw from and to train in",
    "belief.safetensors": "the same, as arrays",
    "policy.safetensors": "the policy, for onlinebayes.load_policy",
    "policy.md": "what the policy sees and does, and where it comes from",
    "best": "the policy of the best step",
}
"""The other files that a folder may hold -> their contents."""


def show(folder: str | Path, *, html: bool = False) -> None:
    """Open the page and the recordings of a folder, or say how to open them, and what else is there.

    Args:
        folder: that a command or a run wrote.
        html: open the page only.

    Raises:
        BadInput: the folder is not there, holds neither a report nor a run, or no page although one is asked for.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise BadInput("no such folder", "name the folder given to --out, or a run's", where=str(folder))
    pages = [(name, folder / name) for name in PAGES if (folder / name).is_file()]
    recordings = sorted(filter(Path.is_file, folder.glob(RECORDINGS)), key=lambda path: (len(path.name), path.name))
    if not pages and (html or not recordings):
        raise BadInput(
            f"holds none of {', '.join(PAGES)}", "name the folder given to --out, or a run's", where=str(folder)
        )
    screen = has_screen()
    for name, page in pages:
        opened = screen and _opened_in_browser(page)
        _tell(PAGES[name], f"{page.resolve()}{'' if opened else '   (open it in a browser)'}")
    if html:
        return
    if recordings:
        paths = [str(_readable(path)) for path in recordings]
        viewer = shutil.which("rerun") or str(Path(sys.executable).with_name("rerun"))
        started = screen and _started([viewer, *paths])
        where = ", ".join(str(path.resolve()) for path in recordings)
        _tell("recording", f"{where}{'' if started else f'   (open it with: rerun {shlex.join(paths)})'}")
    for pattern, what in CONTENTS.items():
        if found := sorted(folder.glob(pattern)):
            _tell("", f"{found[-1].name}: {what}")


def _readable(recording: Path) -> Path:
    """The recording, or a copy of what of it the viewer can read."""
    if whole_bytes(recording) == recording.stat().st_size:
        return recording
    copy = Path(tempfile.mkdtemp(prefix="onlinebayes-")) / recording.name
    copy_whole(recording, copy)
    return copy


def _tell(label: str, text: str) -> None:
    print(f"{label + ':' if label else '':<10} {text}")


def has_screen() -> bool:
    """Check whether a window can be opened here."""
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
