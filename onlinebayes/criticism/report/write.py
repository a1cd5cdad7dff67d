"""One folder for one result."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.criticism.report.html import to_html
from onlinebayes.criticism.report.json import to_json
from onlinebayes.criticism.report.recording import write_recording
from onlinebayes.criticism.report.refined import left_out, noted, write_refined
from onlinebayes.criticism.results import Criticism
from onlinebayes.runs import write_atomic

FILES = ("report.html", "run.rrd", "report.json")
"""What every command writes."""


def write_report(
    result: Criticism, out_dir: str | Path, *, title: str = "", problem: str | Path | None = None
) -> tuple[str, ...]:
    """Write report.json, report.html and run.rrd, and for ``refine`` the refined model, each file atomically.

    Args:
        result: what ``compare``, ``diagnose`` or ``refine`` returned.
        out_dir: folder; made if it is missing, its older report is replaced.
        title: what was criticised, for the page's head.
        problem: the problem file, where there is one, for refined.toml.

    Returns:
        Names of the files written.

    Raises:
        BadInput: the folder cannot be made or written.
    """
    folder, result = Path(out_dir), noted(result)
    refined = write_refined(result, folder, problem) if result.command == "refine" else ()
    lacking = left_out(result) if "refined.xml" in refined else {}
    write_atomic(folder / "report.html", to_html(result, title=title, refined=refined, left_out=lacking))
    write_recording(result, folder / "run.rrd")
    # Last, because programs that wait for the result wait for this one.
    write_atomic(folder / "report.json", to_json(result))
    return (*refined, *FILES)
