"""One folder a run: its checkpoints, its log, its recording; held by one process at a time.

with RunFolder("out/pendulum", "pendulum") as folder:
    checkpoint = folder.checkpoints.load()          # None in a new folder
    folder.checkpoints.save(state)
    folder.path("run.rrd")
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from onlinebayes.runs.checkpoints import Checkpoints
from onlinebayes.runs.errors import BadInput
from onlinebayes.runs.files import remove_partial, write_atomic
from onlinebayes.runs.lock import Lock

ABOUT, LOCK = "run.json", ".lock"


class RunFolder:
    """A run's folder; as a context it is held by this process.

    The lock belongs to the process and ends with it, however it ends.

    Args:
        folder: made if it is missing.
        recipe: which kind of run.
        settings: what the run was begun with; a run goes on only with the same.
        objective: settings of what learns in it; a run goes on only with the same, where its folder tells any.
        keep: how many checkpoints are kept.

    Raises:
        BadInput: the folder cannot be made or written, is a file, is held by another process, or is that of another
            recipe or of other settings.
    """

    def __init__(
        self,
        folder: str | Path,
        recipe: str,
        *,
        settings: Mapping[str, Any] | None = None,
        objective: Mapping[str, Any] | None = None,
        keep: int = 3,
    ) -> None:
        self.folder, self.recipe = Path(folder), recipe
        self.settings, self.objective = dict(settings or {}), dict(objective or {})
        self.checkpoints = Checkpoints(self.folder, recipe, keep=keep)
        self._lock = Lock(self.folder / LOCK)

    def __enter__(self) -> RunFolder:
        where = str(self.folder)
        if self.folder.exists() and not self.folder.is_dir():
            raise BadInput("is a file", "give the name of a folder", where=where)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(
                f"cannot write here: {error.strerror}", "choose a folder you may write to", where=where
            ) from error
        if not os.access(self.folder, os.W_OK | os.X_OK):
            raise BadInput("cannot write here: the folder is read-only", "choose another folder", where=where)
        self._lock.acquire()
        try:
            self._claim()
            remove_partial(self.folder)
        except BaseException:
            self._lock.release()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()

    def path(self, name: str) -> Path:
        """Return the path of a file of the run."""
        return self.folder / name

    def _claim(self) -> None:
        """Write down whose folder it is, or see that it is ours."""
        about = self.folder / ABOUT
        told = {"recipe": self.recipe, "settings": self.settings, "objective": self.objective}
        mine = json.loads(json.dumps(told, default=str))
        if not about.exists():
            write_atomic(about, json.dumps(mine, indent=1) + "\n", durable=True)
            return
        try:
            theirs = json.loads(about.read_text("utf-8"))
            recipe, settings = theirs["recipe"], dict(theirs["settings"])
            objective = dict(theirs.get("objective", {}))  # runs of before it was kept have none
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise BadInput(f"{ABOUT} cannot be read", "choose another folder", where=str(self.folder)) from error
        if recipe != self.recipe:
            raise BadInput(
                f"the folder holds a run of '{recipe}', not of '{self.recipe}'",
                "choose another folder",
                where=str(self.folder),
            )
        other = _differences(settings, mine["settings"])
        if objective and self.objective:
            other += _differences(objective, mine["objective"])
        if other:
            raise BadInput(
                f"the run was begun with {', '.join(other)}",
                "give the same settings, or another folder",
                where=str(self.folder),
            )


def _differences(theirs: Mapping[str, Any], mine: Mapping[str, Any]) -> list[str]:
    """Each value that is another one now, in words."""
    names = sorted({*theirs, *mine})
    return [
        f"{name} = {theirs.get(name)} (now {mine.get(name)})" for name in names if theirs.get(name) != mine.get(name)
    ]
