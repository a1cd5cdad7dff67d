"""One folder for one result."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from onlinebayes.criticism import Criticism, next_unit
from onlinebayes.inference import saving
from onlinebayes.report.html import to_html
from onlinebayes.report.json import to_json
from onlinebayes.report.model_files import left_out, lost
from onlinebayes.report.recording import write_recording
from onlinebayes.report.refined import noted, write_refined
from onlinebayes.runs import Attempts, together, write_atomic

FILES = ("report.html", "run.rrd", "report.json")
"""Files that every command writes."""

NEXT_UNIT = "next_unit.json"
"""The distribution of the next unit's parameters, where some have one value in every unit."""


def write_report(
    result: Criticism,
    out_dir: str | Path,
    *,
    title: str = "",
    problem: str | Path | None = None,
    attempts: Attempts | None = None,
) -> tuple[str, ...]:
    """Write report.json, report.html and run.rrd, and for ``refine`` the refined model: they appear together.

    Where parameters have one value in every unit, next_unit.json stands beside them.

    A part that fails leaves the others as they are; on a full disk none is written.

    Args:
        result: what ``compare``, ``diagnose`` or ``refine`` returned.
        out_dir: folder; made if it is missing, its older report is replaced.
        title: what was criticised, for the page's head.
        problem: the problem file, where there is one, for refined.toml.
        attempts: takes what fails; the first failure is raised in the end where there is none.

    Returns:
        Names of the files written.

    Raises:
        BadInput: the folder cannot be made or written, or the disk is full.
    """
    noting = attempts or Attempts()
    begun = len(noting.errors)
    with together():
        written = _write(result, Path(out_dir), title, problem, noting)
    if noting.errors[begun:] and (attempts is None or not written):
        raise noting.errors[begun]
    return tuple(written)


def _write(result: Criticism, folder: Path, title: str, problem: str | Path | None, noting: Attempts) -> list[str]:
    result = noting.made("a note on refined.xml", lambda: noted(result), result)
    refined = write_refined(result, folder, problem, noting) if result.command == "refine" else ()
    lacking, missing = dict[str, str](), dict[str, str]()
    with noting.attempt("what refined.xml lacks"):
        if "refined.xml" in refined:
            lacking, missing = dict(left_out(result)), dict(lost(result))
    page = to_html(result, title=title, refined=refined, left_out=lacking, lost=missing, attempts=noting)
    written = list(refined)
    if result.fleet:
        with noting.attempt(NEXT_UNIT):
            saving.save(next_unit(result), folder / NEXT_UNIT)
            written.append(NEXT_UNIT)
    for name, write in (
        ("report.html", lambda path: write_atomic(path, page)),
        ("run.rrd", lambda path: write_recording(result, path)),
        # Last, because programs that wait for the result wait for this one.
        ("report.json", lambda path: write_atomic(path, to_json(_with_failures(result, noting)))),
    ):
        with noting.attempt(name):
            write(folder / name)
            written.append(name)
    return written


def _with_failures(result: Criticism, attempts: Attempts) -> Criticism:
    """The result that also says what failed in its report."""
    return replace(result, failed=tuple(dict.fromkeys((*result.failed, *attempts.failed))))
