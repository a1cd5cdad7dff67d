"""``compare``, ``diagnose`` or ``refine`` on a loaded problem file, with progress; Ctrl-C keeps what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from onlinebayes.criticism import BUDGET_S, Criticism, Question, compare, diagnose, refine
from onlinebayes.problems.problem_file import ProblemFile, read_toml
from onlinebayes.problems.wiring_lines import composed
from onlinebayes.runs import Attempts, Interrupt, Stages, users_memo


def criticise(question: Question, problem: ProblemFile, budget_s: float = BUDGET_S) -> Criticism:
    """The result of a command on a problem; one that is stopped gives what it has found until then.

    Args:
        question: which command.
        problem: of :func:`load_problem`.
        budget_s: processor time that a search may take [s].

    Raises:
        BadInput: the log does not suit the model.
        Stopped: it was interrupted before the base model was fitted.
    """
    result, attempts = _criticised(question, problem, budget_s), Attempts()
    result = attempts.made("the lines for this problem file", lambda: _with_lines_of(problem, result), result)
    return replace(result, failed=(*result.failed, *attempts.failed))


def _criticised(question: Question, problem: ProblemFile, budget_s: float) -> Criticism:
    model, data, how = problem.simulator, problem.measurement, problem.selection
    memo = users_memo()
    stopping = "onlinebayes: stopping with what is known; Ctrl-C again ends the step in hand at once"
    with Interrupt(stopping) as interrupt, Stages() as say:
        asked: dict[Question, Callable[..., Criticism]] = {
            "compare": compare,
            "diagnose": partial(diagnose, candidates=problem.candidates),
            "refine": partial(refine, candidates=problem.candidates),
        }
        return asked[question](
            model,
            data,
            holdout=problem.holdout,
            selection=how,
            scope=problem.scope,
            progress=say,
            interrupt=interrupt,
            memo=memo,
            budget_s=budget_s,
        )


def _with_lines_of(problem: ProblemFile, result: Criticism) -> Criticism:
    """The result whose lines that mend a fault of the log go with what the problem file says already."""
    if result.wiring is None:
        return result
    content, found = read_toml(problem.path), result.wiring
    others = tuple((fault, composed(lines, content)) for fault, lines in found.alternatives)
    mended = replace(found, lines=composed(found.lines, content), alternatives=others)
    return replace(result, wiring=mended)
