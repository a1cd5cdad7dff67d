"""``onlinebayes next problem.toml --out DIR``: criticise, then propose the recording that decides what is open."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

from onlinebayes.cli.outputs import check_apart, writable
from onlinebayes.cli.work import title_of
from onlinebayes.criticism import BUDGET_S, Plan, next_experiment
from onlinebayes.identification import split
from onlinebayes.problems import allowed_in, criticise, load_problem
from onlinebayes.report import PLAN_FILES, plan_words, write_plan
from onlinebayes.runs import BadInput, Interrupt, Stopped, one_line

WIDTH, COLUMN = 80, 12


def propose_next(problem_file: str, out: str, add: Sequence[str] = (), budget_s: float = BUDGET_S) -> int:
    """Do it and write next.csv, next.html and next.json; returns the exit status.

    Args:
        problem_file: path of the TOML file.
        out: folder for the files.
        add: effects ``name@target`` added by hand.
        budget_s: processor time that the search may take [s].

    Raises:
        BadInput: the problem cannot be used, nothing is admissible, or the folder not be written.
    """
    notes: list[str] = []
    problem = load_problem(problem_file, add, note=notes.append)
    for line in notes:
        _log(line)
    if problem.scope:
        raise BadInput(
            "an experiment for parameters that differ between runs is not planned by this version",
            'leave out [runs], [effects.scope] and scope = "per_run" or "per_unit", or plan for one run\'s constants',
            where=problem_file,
        )
    allowed = allowed_in(problem)
    check_apart([Path(out) / name for name in PLAN_FILES], problem.inputs)
    with writable(Path(out)) as folder:
        try:
            result = criticise("refine", problem, budget_s)
            if result.interrupted:
                return _stopped()
            fit_runs, _ = split(problem.measurement, problem.holdout)
            with Interrupt("onlinebayes: stopping; Ctrl-C again ends the step in hand at once") as interrupt:
                plan = next_experiment(
                    result,
                    fit_runs,
                    allowed=allowed,
                    progress=_log,
                    interrupt=interrupt,
                )
        except Stopped:
            return _stopped()
        except BadInput as error:
            raise BadInput(str(error), where=problem_file) from error
        if plan is None:
            return _stopped()
        names = write_plan(plan, folder, title=title_of(problem.path))
    print(summary(plan, folder, names))
    return 0


def summary(plan: Plan, folder: Path, names: Sequence[str]) -> str:
    """Summarise the recording that is planned, and why, in lines of at most 80 columns."""
    lines = [("verdict", str(plan.verdict)), ("next", plan_words.headline(plan))]
    if plan.decides:
        lines.append(("start", plan_words.beginning(plan)))
    for rivalry in plan.rivalries:
        lines.append((plan_words.outcome(rivalry), plan_words.expected(rivalry)))
        if rivalry.structural:
            lines.append(("", plan_words.remedy(rivalry)))
    if plan.decides:
        lines.append(("then", plan_words.instructions(plan)))
    lines.append(("compared", f"{len(plan.tried)} admissible inputs; {plan.refused} left the limits at any size"))
    lines += [("wrote", str(folder / name)) for name in names]
    return "\n".join(_wrapped(f"{key}:" if key else "", what) for key, what in lines)


def _wrapped(key: str, what: str) -> str:
    """A key of 12 columns and its text, broken between words; paths stay whole."""
    lines = textwrap.wrap(what, WIDTH - COLUMN, break_long_words=False, break_on_hyphens=False)
    return "\n".join(f"{key if k == 0 else '':<{COLUMN}}{line}" for k, line in enumerate(lines))


def _stopped() -> int:
    """Exit status where Ctrl-C or SIGTERM came first."""
    _log("stopped before its end; nothing is proposed")
    return 130


def _log(line: str) -> None:
    print(f"onlinebayes: {one_line(line)}", file=sys.stderr, flush=True)
