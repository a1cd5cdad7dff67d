"""One of compare, diagnose, refine from a problem file: load, check, criticise, write, sum up."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from onlinebayes.cli.outputs import check_apart, clear, names_of, writable
from onlinebayes.cli.summary import summary
from onlinebayes.criticism import BUDGET_S, Question
from onlinebayes.problems import criticise, load_problem
from onlinebayes.report import REPORT_FILES, noted, write_report
from onlinebayes.runs import Attempts, BadInput, Stopped, one_line

FAILED = "the report holds all that was found without it"


def work(command: Question, problem_file: str, out: str, add: Sequence[str] = (), budget_s: float = BUDGET_S) -> int:
    """Do one command and write its files; returns the exit status: 1 where a part of the work failed.

    Args:
        command: ``"compare"``, ``"diagnose"`` or ``"refine"``.
        problem_file: path of the TOML file.
        out: folder for report.json, report.html and run.rrd.
        add: effects ``name@target`` added by hand.
        budget_s: processor time that the search may take [s].

    Raises:
        BadInput: the problem cannot be used, or the folder not be written.
    """
    notes: list[str] = []  # said once the file is sound: an error is one line
    problem = load_problem(problem_file, add, note=notes.append)
    for line in notes:
        _log(line)
    check_apart([Path(out) / name for name in names_of(command)], problem.inputs)
    with writable(Path(out)) as folder:
        try:
            result = criticise(command, problem, budget_s)
        except Stopped:
            _log("stopped before the model was fitted; nothing is written")
            return 130
        except BadInput as error:
            raise BadInput(str(error), where=problem_file) from error
        result = dataclasses.replace(result, holdout_looks=result.holdout_looks + earlier_looks(folder))
        attempts = Attempts()
        result = attempts.made("a note on refined.xml", lambda: noted(result), result)
        files = write_report(result, folder, title=title_of(problem.path), problem=problem.path, attempts=attempts)
        stale = clear(folder, files, problem.inputs)
    if stale:
        _log(f"taken away, as an earlier command left it: {', '.join(stale)}")
    more = [name for name in files if name not in REPORT_FILES]
    print(attempts.made("the summary", lambda: summary(result, folder, more), f"report:    {folder}"))
    failed = dict.fromkeys((*result.failed, *attempts.failed))
    for line in failed:
        _log(f"{line}; {FAILED}")
    if result.interrupted:
        _log("stopped before its end; the report holds what was found until then")
        return 130
    return 1 if failed else 0


def title_of(path: Path) -> str:
    """Return the machine's name in the report: the file's name, or its folder's where it is plain ``problem.toml``."""
    return path.stem if path.stem != "problem" else path.resolve().parent.name


def earlier_looks(folder: Path) -> int:
    """Return how often held-out runs were opened for this folder before, from the report there (0 without one)."""
    try:
        looks = json.loads((folder / "report.json").read_text(encoding="utf-8"))["holdout_looks"]
    except (OSError, ValueError, KeyError, TypeError):
        return 0
    return looks if isinstance(looks, int) and not isinstance(looks, bool) and looks > 0 else 0


def _log(line: str) -> None:
    print(f"onlinebayes: {one_line(line)}", file=sys.stderr, flush=True)
