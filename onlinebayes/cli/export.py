"""``onlinebayes export FOLDER --to TARGET --out DIR``: what ``refine`` found, for the place where people train."""

from __future__ import annotations

import sys
from pathlib import Path

from onlinebayes.cli.outputs import check_apart, writable
from onlinebayes.export import export, files_of
from onlinebayes.runs import one_line


def take_home(folder: str, target: str, out: str) -> int:
    """Write the files of an export; returns the exit status.

    Args:
        folder: that ``refine`` wrote to.
        target: one of :data:`onlinebayes.export.TARGETS`.
        out: folder for the files.

    Raises:
        BadInput: the folder cannot be used, or the other one not be written.
    """
    read = {path: "a file of the refined folder" for path in Path(folder).glob("*") if path.is_file()}
    notes: list[str] = []
    names = files_of(target)
    check_apart([Path(out) / name for name in names], read)
    with writable(Path(out), names) as place:
        export(folder, target, place, note=notes.append)
    for line in notes:
        print(f"onlinebayes: {one_line(line)}", file=sys.stderr, flush=True)
    print(f"wrote:     {', '.join((str(Path(out) / names[-1]), *names[:-1]))}")
    return 0
