"""``onlinebayes posterior problem.toml --out DIR``: what the log says of the free parameters.

In the place of the problem file may stand the folder that ``refine`` wrote to: then each model that it left open has a
posterior, with its weight.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from onlinebayes.cli.outputs import check_apart, writable
from onlinebayes.cli.summary import labelled
from onlinebayes.cli.work import title_of
from onlinebayes.posterior import (
    MOST_MODELS,
    LogPosterior,
    corner_plots,
    lines,
    names_of,
    posterior_of_log,
    side_by_side,
    write_posterior,
)
from onlinebayes.problems import ProblemFile, load_problem, refined_files
from onlinebayes.report import POSTERIOR_PAGE, write_posterior_page
from onlinebayes.runs import BadInput, Interrupt, Stages, Stopped, one_line, together, users_memo

FILES = (*names_of(MOST_MODELS), POSTERIOR_PAGE)
"""All that the command may write."""


def infer_posterior(problem_file: str, out: str, add: Sequence[str] = ()) -> int:
    """Do it and write posterior.json, belief.json, corner.png and posterior.html; returns the exit status.

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
    check_apart([Path(out) / name for name in FILES], inputs)
    with writable(Path(out), FILES) as folder:
        try:
            found = [replace(_inferred(one), weight=weight) for one, weight in zip(problems, weights, strict=True)]
        except Stopped:
            _log("stopped before its end; nothing is written")
            return 130
        except BadInput as error:
            raise BadInput(str(error), where=problem_file) from error
        title = title_of(problems[0].path)
        pictures = corner_plots(found, title)
        with together():
            names = write_posterior(found, folder, title=title, pictures=pictures)
            names = (*names, write_posterior_page(found, pictures, folder, title=title))
        stale = [folder / name for name in FILES if name not in names]
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
    """Say what is known of every parameter and how far it can be trusted, in lines of at most 80 columns."""
    page, *others = (str(folder / names[-1]), *names[:-1])
    told = lines(models[0]) if len(models) == 1 else side_by_side(models)
    wrote = ("wrote", f"{', '.join((page, *others))}; to open: onlinebayes show {folder}")
    return "\n".join(line for label, text in (*told, wrote) for line in labelled(label, text))


def _log(line: str) -> None:
    print(f"onlinebayes: {one_line(line)}", file=sys.stderr, flush=True)
