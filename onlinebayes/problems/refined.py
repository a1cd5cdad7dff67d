"""The output of ``refine``, as objects again: the mended model, what is known of its parameters, worlds to train in.

    refined = load_refined("out/refine")
    env = SimulatorEnv(refined.worlds(64), task)                  # an action lasts refined.control_period
    env = TransformedEnv(env, ParameterRandomization(refined.belief))

    refined.problem.simulator      the model with its accepted effects, as a fit takes it; its bounds are the prior
    refined.theta                  the fitted values, in the order of its parameters

refined.toml holds the problem, refined-2.toml and so on the other models that the log leaves open, report.json the
values, what is known of them together (:mod:`.worlds`) and how the model was integrated.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from statistics import fmean
from typing import Any

from jaxtyping import Float
from torch import Tensor

from onlinebayes.criticism import joined, prepare
from onlinebayes.identification import Integration, address_of, unwrap
from onlinebayes.inference import TruncatedMixture
from onlinebayes.problems.control_period import control_period
from onlinebayes.problems.problem_file import ProblemFile, load_problem
from onlinebayes.problems.worlds import load_worlds
from onlinebayes.report import REFINED_FILES
from onlinebayes.runs import BadInput
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Refined:
    """A refined model.

    Args:
        problem: of refined.toml.
        theta: fitted values (P,) in the order of the simulator's parameters [SI]; the mean of the runs where a
            parameter differs between them, known values (``[runs]``) among them.
        sd: standard deviations (P,) of the fit.
        integration: how the model was run that these values are of; as the model file says where None.
        rivals: of refined-2.toml and so on.
    """

    problem: ProblemFile
    theta: Float[Tensor, " P"]
    sd: Float[Tensor, " P"]
    integration: Integration | None = None
    rivals: tuple[ProblemFile, ...] = ()

    @cached_property
    def belief(self) -> TruncatedMixture:
        """What the log says of the parameters of :meth:`worlds`, correlations and the other models included.

        Raises:
            BadInput: report.json is damaged, or of another model, or the log has a fault that was not mended yet.
        """
        return load_worlds(self.problem.path.parent).worlds.belief

    @cached_property
    def control_period(self) -> float:
        """Time for which the log's controller held a command [s], in whole timesteps."""
        timestep = self._simulator.timestep
        return timestep * max(1, round(control_period(self.problem.measurement) / timestep))

    def worlds(self, number: int, control_period: float | None = None) -> Identifiable:
        """Worlds of the refined model, with the effects of all models that the log leaves open.

        They are integrated as the fit was, and one step lasts a control period.

        Args:
            number: how many.
            control_period: how long an action lasts [s], a whole number of timesteps; that of the log by default.

        Raises:
            BadInput: no whole number of timesteps.
        """
        period = self.control_period if control_period is None else control_period
        return self._simulator.with_dt(period).with_worlds(number)

    @cached_property
    def _simulator(self) -> Identifiable:
        first, *others = (self._ready(problem) for problem in (self.problem, *self.rivals))
        try:
            model = joined(first, others)
        except BadInput:  # as the report was: the first alone
            model = first
        return model if self.integration is None else self.integration.of(model)

    @staticmethod
    def _ready(problem: ProblemFile) -> Identifiable:
        """The model as a command makes it ready for its log."""
        task = prepare(problem.simulator, problem.measurement, problem.holdout, problem.selection, problem.scope)
        inner = unwrap(task.simulator)
        assert isinstance(inner, Identifiable)
        return inner


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
        report = json.loads((folder / "report.json").read_text("utf-8"))
        values = [(name, float(each["mean"]), float(each["sd"] or 0.0)) for name, each in report["parameters"].items()]
        integration = _integration(report)
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
    rivals = [folder / name for name in REFINED_FILES if name.startswith("refined-") and (folder / name).is_file()]
    return Refined(problem, space.clamp(means), sds, integration, tuple(map(load_problem, rivals)))


def _integration(report: Mapping[str, Any]) -> Integration | None:
    told = report.get("integration")
    return None if told is None else Integration(**told)


def _known(problem: ProblemFile, name: str, nominal: float) -> list[float]:
    """The value of every run, where some runs know it and none fits it: elsewhere the model's own; else nothing."""
    scope = problem.scope
    if scope is None or not any(name in values for values in scope.known.values()):
        return []
    return [scope.constants(run).get(name, nominal) for run in problem.measurement.runs]
