"""One folder for one result."""

from __future__ import annotations

from pathlib import Path

from onlinebayes.criticism.report.html import to_html
from onlinebayes.criticism.report.json import to_json
from onlinebayes.criticism.report.recording import write_recording
from onlinebayes.criticism.report.refined import left_out, refined_files
from onlinebayes.criticism.results import Criticism
from onlinebayes.runs import write_atomic


def write_report(result: Criticism, out_dir: str | Path, *, title: str = "") -> None:
    """Write report.json, report.html and run.rrd, each atomically.

    Args:
        result: what ``compare``, ``diagnose`` or ``refine`` returned.
        out_dir: folder; made if it is missing, its older report is replaced.
        title: what was criticised, for the page's head.

    Raises:
        BadInput: the folder cannot be made or written.
    """
    folder = Path(out_dir)
    files = refined_files(result)
    lacking = left_out(result) if files else ()
    write_atomic(folder / "report.html", to_html(result, title=title, refined=files, left_out=lacking))
    write_recording(result, folder / "run.rrd")
    # Last, because programs that wait for the result wait for this one.
    write_atomic(folder / "report.json", to_json(result))
