"""How a run was made, for its page: date, command, commit, and what ``run.json`` says of its settings."""

from __future__ import annotations

import json
import shlex
import sys
from datetime import UTC, datetime
from pathlib import Path

from onlinebayes.runs import commit, versions

WORKER = "multiprocessing"
"""In the arguments of a process that another one began: nobody typed them."""


def made_by(folder: Path) -> dict[str, str]:
    """What is said -> its value; what is not known is left out."""
    said = {"date": datetime.now(UTC).strftime("%Y-%m-%d")}
    words = [Path(sys.orig_argv[0]).name, *sys.orig_argv[1:]] if sys.orig_argv else []
    if words and not any(WORKER in word for word in words):
        said["command"] = shlex.join(words)
    if code := commit():
        said["commit"] = code
    said["versions"] = ", ".join(f"{name} {version}" for name, version in versions().items())
    try:
        about = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        about = {}
    for part in ("settings", "objective"):
        if found := about.get(part):
            said[part] = ", ".join(f"{name} {value}" for name, value in found.items())
    return said
