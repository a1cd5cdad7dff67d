"""``onlinebayes posterior problem.toml --out DIR``: what the log says of the free parameters.

In the place of the problem file may stand the folder that ``refine`` wrote to: then each model that it left open has a
posterior, with its weight.
"""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from onlinebayes.cli.outputs import check_apart, writable
from onlinebayes.cli.work import title_of
from onlinebayes.posterior import (
    MOST_MODELS,
    SHOWN,
    LogPosterior,
    lines,
    names_of,
    posterior_of_log,
    side_by_side,
    write_posterior,
)
from onlinebayes.problems import ProblemFile, load_problem, refined_files
from onlinebayes.runs import BadInput, Interrupt, Stages, Stopped, one_line, users_memo

WIDTH, COLUMN, LINES = 80, 11, 10


def infer_posterior(problem_file: str, out: str, add: Sequence[str] = ()) -> int:
    """Do it and write posterior.json, belief.json and corner.png; returns the exit status.

    Args:
        problem_file: path of the TOML file, or of a folder that ``refine`` wrote to.
        out: folder for the files.
        add: effects ``name@target`` added by hand.

    Raises:
        BadInput: the problem cannot be used, or the folder not be written.
    """
    notes: list[str] = []
    paths, weights = models_of(Path(problem_file))
    problems = [load_problem(path, add, note=notes.append) for path in paths]
    for line in dict.fromkeys(notes):
        _log(line)
    inputs = {path: what for problem in problems for path, what in problem.inputs.items()}
    check_apart([Path(out) / name for name in names_of(MOST_MODELS)], inputs)
    with writable(Path(out), names_of(MOST_MODELS)) as folder:
        try:
            found = [replace(_inferred(one), weight=weight) for one, weight in zip(problems, weights, strict=True)]
        except Stopped:
            _log("stopped before its end; nothing is written")
            return 130
        except BadInput as error:
            raise BadInput(str(error), where=problem_file) from error
        names = write_posterior(found, folder, title=title_of(problems[0].path))
        stale = [folder / name for name in names_of(MOST_MODELS) if name not in names]
        for path in stale:  # of an earlier command that had more models
            path.unlink(missing_ok=True)
    print(summary(found, folder, names))
    return 0


def models_of(path: Path) -> tuple[list[Path], list[float]]:
    """Problem files of the models, and their weights.

    Raises:
        BadInput: a folder in which ``refine`` left no models, or not those of its report.
    """
    return refined_files(path) if path.is_dir() else ([path], [1.0])


def _inferred(problem: ProblemFile) -> LogPosterior:
    stopping = "onlinebayes: stopping; Ctrl-C again ends the step in hand at once"
    with Interrupt(stopping) as interrupt, Stages() as say:
        return posterior_of_log(
            problem.simulator,
            problem.measurement,
            holdout=problem.holdout,
            selection=problem.selection,
            scope=problem.scope,
            progress=say,
            interrupt=interrupt,
            memo=users_memo(),
        )


def summary(models: Sequence[LogPosterior], folder: Path, names: Sequence[str]) -> str:
    """Summarise the posterior of each parameter and how far it can be trusted, in lines of at most 80 columns.

    Of one model ten lines: the parameters that are known best stand in posterior.json where there are too many.
    """
    wrote = ("wrote", ", ".join((str(folder / names[-1]), *names[:-1])))
    if len(models) > 1:
        return _text([*side_by_side(models), *lines(models[0], 0), wrote])
    texts = (_text([*lines(models[0], shown), wrote]) for shown in range(SHOWN, -1, -1))
    return next((text for text in texts if text.count("\n") < LINES), _text([*lines(models[0], 1), wrote]))


def _text(told: Sequence[tuple[str, str]]) -> str:
    return "\n".join(_wrapped(label and f"{label}:", text) for label, text in told)


def _wrapped(label: str, text: str) -> str:
    """A label in a column of its own, the text beside it; paths and names stay whole."""
    wrapped = textwrap.wrap(text, WIDTH - COLUMN, break_long_words=False, break_on_hyphens=False)
    return "\n".join(f"{label if k == 0 else '':<{COLUMN}}{line}" for k, line in enumerate(wrapped))


def _log(line: str) -> None:
    print(f"onlinebayes: {one_line(line)}", file=sys.stderr, flush=True)
