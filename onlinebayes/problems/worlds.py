"""The worlds that a folder of ``refine`` leaves open, for training, without a new fit.

    worlds = load_worlds("out/refine").worlds           # as criticism.worlds_of of the result that wrote the folder
    theta = worlds.sample((64,))

refined.toml and its rivals hold the models, report.json what is known of their parameters: mean, sd and correlation.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import MOST_HYPOTHESES, ModelMixture, WeightedModel, mixture_of
from onlinebayes.identification import FittedModel
from onlinebayes.parameters import ParameterSpace
from onlinebayes.problems.problem_file import ProblemFile, load_problem
from onlinebayes.runs import BadInput

UNIFORM = math.sqrt(12.0)
"""A uniform distribution's width in its sd: of a parameter of which the report says nothing."""


@dataclass(frozen=True, eq=False)
class RefinedModels:
    """What a folder of ``refine`` holds.

    Args:
        problems: of the model that was found, and of those that the log cannot tell from it.
        worlds: of all of them.
        correlated: whether the report has the correlations; one of an earlier version has not.
        report: report.json.
    """

    problems: tuple[ProblemFile, ...]
    worlds: ModelMixture
    correlated: bool
    report: Mapping[str, Any]


def load_worlds(folder: str | Path) -> RefinedModels:
    """Read what ``refine`` wrote to a folder.

    Raises:
        BadInput: the folder holds no refined model, its report is of another one, or the log has a fault that
            refined.toml puts right and that was not fitted since.
    """
    folder = Path(folder)
    files, weights = refined_files(folder)
    report = read_report(folder)
    if report.get("wiring"):
        cure = "run refine on its refined.toml, which puts it right, and name that folder"
        raise BadInput("its log has a fault, and the values are fitted to that", cure, where=str(folder))
    problems = tuple(load_problem(file) for file in files)
    told = report.get("hypotheses") or [report]
    models = [
        _model(problem, one, weight, folder) for problem, one, weight in zip(problems, told, weights, strict=True)
    ]
    correlated = all("belief" in one for one in told)
    try:
        worlds = mixture_of(models[0].model.simulator, models)
    except BadInput:  # the effects of two of them cannot stand beside each other
        worlds = mixture_of(models[0].model.simulator, [replace(models[0], weight=1.0)])
    return RefinedModels(problems, worlds, correlated, report)


def refined_files(folder: Path) -> tuple[list[Path], list[float]]:
    """Problem files of the models that ``refine`` left in a folder, and their weights.

    Raises:
        BadInput: there are none, or not those of its report.
    """
    files = [folder / "refined.toml", *(folder / f"refined-{k + 2}.toml" for k in range(MOST_HYPOTHESES))]
    files = [file for file in files if file.is_file()]
    if not files:
        raise BadInput(
            "holds no refined.toml", "name a problem file, or a folder that refine wrote to", where=str(folder)
        )
    try:
        weights = [float(one["weight"]) for one in read_report(folder)["hypotheses"]] or [1.0]
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"report.json cannot be read: {error}", "run refine again", where=str(folder)) from error
    if len(weights) != len(files):
        problem = f"report.json has {len(weights)} models, beside {len(files)} refined problem files"
        raise BadInput(problem, "run refine again, or name one of the files", where=str(folder))
    return files, weights


def read_report(folder: Path) -> Mapping[str, Any]:
    """report.json of a folder; raises :class:`BadInput` where it cannot be read."""
    try:
        found = json.loads((folder / "report.json").read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise BadInput(f"report.json cannot be read: {error}", "run refine again", where=str(folder)) from error
    if not isinstance(found, dict):
        raise BadInput("report.json holds no report", "run refine again", where=str(folder))
    return found


def _model(problem: ProblemFile, told: Mapping[str, Any], weight: float, folder: Path) -> WeightedModel:
    """One of the models as a fit would give it."""
    space = problem.simulator.parameters
    try:
        mean, covariance = _moments(space, told)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(f"report.json cannot be read: {error!r}", "run refine again", where=str(folder)) from error
    effects = tuple(effect.key for effect in problem.simulator.effects)
    fitted = FittedModel(problem.simulator, mean, covariance, {}, effects, ())
    return WeightedModel(weight, tuple(told.get("accepted", ())), fitted)


def _moments(space: ParameterSpace, told: Mapping[str, Any]) -> tuple[Float[Tensor, " P"], Float[Tensor, "P P"]]:
    """Mean and covariance of the space's parameters [SI]; of an earlier version's report without correlations."""
    belief, known = told.get("belief"), told["parameters"]
    if belief is None:
        mean = space.vector({name: float(known[name]["mean"]) for name in space})
        return mean, torch.diag(torch.tensor([_sd(space, n, known[n]["sd"]) for n in space], dtype=torch.float64) ** 2)
    place = {name: k for k, name in enumerate(belief["names"])}
    order = [place[name] for name in space]
    mean = torch.tensor([float(belief["mean"][k]) for k in order], dtype=torch.float64)
    sd = torch.tensor([_sd(space, name, belief["sd"][place[name]]) for name in space], dtype=torch.float64)
    correlation = torch.tensor(
        [[belief["correlation"][i][j] or 0.0 for j in order] for i in order], dtype=torch.float64
    )
    return mean, sd[:, None] * correlation * sd


def _sd(space: ParameterSpace, name: str, told: float | None) -> float:
    """An sd [SI]; where the report has no number for it, that of knowing nothing."""
    return (space[name].high - space[name].low) / UNIFORM if told is None else float(told)
