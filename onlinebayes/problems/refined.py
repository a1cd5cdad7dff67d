"""The output of ``refine``, as objects again: the mended model, and the values that were fitted.

    refined = load_refined("out/refine")
    refined.problem.simulator      the model with its accepted effects; its bounds are still the prior
    refined.theta                  the fitted values, in the order of its parameters
    refined.problem.simulator.reset(refined.theta.expand(worlds, -1))

refined.toml holds the problem, report.json the values (in refined.toml they stand in comments).
"""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import address_of
from onlinebayes.problems.problem_file import ProblemFile, load_problem
from onlinebayes.runs import BadInput


@dataclass(frozen=True)
class Refined:
    """A refined model.

    Args:
        problem: of refined.toml.
        theta: fitted values (P,) in the order of the simulator's parameters [SI]; the mean of the runs where a
            parameter differs between them, known values (``[runs]``) among them.
        sd: standard deviations (P,) of the fit.
    """

    problem: ProblemFile
    theta: Float[Tensor, " P"]
    sd: Float[Tensor, " P"]


def load_refined(folder: str | Path) -> Refined:
    """Read what ``refine`` wrote to a folder.

    Raises:
        BadInput: refined.toml or report.json is missing or cannot be read, or the report lacks a parameter.
    """
    folder = Path(folder)
    for name in ("refined.toml", "report.json"):
        if not (folder / name).is_file():
            raise BadInput(f"holds no {name}", "name the folder that refine wrote to", where=str(folder))
    try:
        estimates = json.loads((folder / "report.json").read_text("utf-8"))["parameters"]
        values = [(name, float(each["mean"]), float(each["sd"] or 0.0)) for name, each in estimates.items()]
    except (ValueError, KeyError, TypeError) as error:
        raise BadInput(f"report.json cannot be read: {error}", "run refine again", where=str(folder)) from error
    problem = load_problem(folder / "refined.toml")
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for name, mean, sd in values:
        found[address_of(name)].append((mean, sd))
    for name, nominal in zip(problem.simulator.parameters, problem.simulator.nominal.tolist(), strict=True):
        if name not in found and (known := _known(problem, name, nominal)):
            found[name] = [(value, 0.0) for value in known]
    missing = [name for name in problem.simulator.parameters if name not in found]
    if missing:
        raise BadInput(f"report.json has no value of {missing[0]}", "run refine again", where=str(folder))
    space = problem.simulator.parameters
    means, sds = (space.vector({name: fmean(pair[k] for pair in found[name]) for name in space}) for k in (0, 1))
    return Refined(problem, space.clamp(means), sds)


def _known(problem: ProblemFile, name: str, nominal: float) -> list[float]:
    """The value of every run, where some runs know it and none fits it: elsewhere the model's own; else nothing."""
    scope = problem.scope
    if scope is None or not any(name in values for values in scope.known.values()):
        return []
    return [scope.constants(run).get(name, nominal) for run in problem.measurement.runs]
