"""``onlinebayes check FOLDER LOG...``: do new logs still fit the refined model, or did the machine change.

Exit status: 0 the model holds, 1 the machine changed, 2 bad input, 3 a fault of ours, 130 stopped.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

from onlinebayes.cli.outputs import check_apart, writable
from onlinebayes.criticism import Check
from onlinebayes.problems import check_logs
from onlinebayes.report import CHECK_FILES, check_words, write_check
from onlinebayes.runs import Stopped

HOLDS, CHANGED = 0, 1
WIDTH, COLUMN, LINES = 80, 11, 10


def check_machine(folder: str, logs: Sequence[str], out: str | None = None) -> int:
    """Do it and write check.json and check.png; returns the exit status.

    Args:
        folder: that ``refine`` wrote to.
        logs: new logs.
        out: folder for the files; the same when None.

    Raises:
        BadInput: the folder or a log cannot be used, or the other folder not be written.
    """
    place = Path(folder if out is None else out)
    check_apart([place / name for name in CHECK_FILES], {Path(log): "a log" for log in logs})
    with writable(place, CHECK_FILES) as there:
        try:
            found = check_logs(folder, logs)
        except Stopped:
            print("onlinebayes: stopped before its end; nothing is written", file=sys.stderr)
            return 130
        write_check(found, there)
    print(summary(found, place))
    return CHANGED if found.verdict == "changed" else HOLDS


def summary(found: Check, folder: Path) -> str:
    """At most ten lines; what does not fit stands in check.json."""
    wrote = _wrapped("wrote", f"{folder / 'check.json'}, check.png")
    told = [line for label, text in check_words.lines(found) for line in _wrapped(label, text)]
    return "\n".join([*told[: LINES - len(wrote)], *wrote])


def _wrapped(label: str, text: str) -> list[str]:
    lines = textwrap.wrap(text, WIDTH - COLUMN, break_long_words=False, break_on_hyphens=False)
    return [f"{f'{label}:' if k == 0 else '':<{COLUMN}}{line}" for k, line in enumerate(lines)]
