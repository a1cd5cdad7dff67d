"""The version of the code that runs: the commit of its repository, with "+" where code was changed since."""

from __future__ import annotations

import subprocess
from pathlib import Path

CODE = ("*.py", "*.xml", "*.toml")


def commit(file: str | Path = __file__) -> str | None:
    """The short hash of the commit from which a file comes; None without git, or where git does not know the file.

    "+" follows where the repository's code differs from that commit; documents may differ.

    Args:
        file: of the code that is asked about; this library's own by default.
    """
    path = Path(file).resolve()
    known = _git(path.parent, "ls-files", "--error-unmatch", path.name)
    if not known or not (short := _git(path.parent, "rev-parse", "--short=8", "HEAD")):
        return None
    changed = _git(path.parent, "status", "--porcelain", "--", *(f":/{kind}" for kind in CODE))
    return short + ("+" if changed or changed is None else "")


def _git(folder: Path, *words: str) -> str | None:
    """Return the output of git; None where it is missing, refuses or takes too long."""
    command = ["git", "--no-optional-locks", "-C", str(folder), *words]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None
