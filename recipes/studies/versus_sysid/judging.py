"""One method on one case, judged by the same windows and names as every other."""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, final

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import start_floor, start_spread
from recipes.studies.job import Job
from recipes.studies.versus_sysid.cases import Case, make
from recipes.studies.versus_sysid.record import COST, Outcome, scored
from recipes.studies.versus_sysid.task import Fitted, Task, rms


@final
@dataclass(frozen=True)
class Trial:
    """A method to try on a case."""

    job: Job
    method: str

    @property
    def name(self) -> str:
        """As :attr:`Outcome.name`."""
        return f"{self.job.name}.{self.method}"


@final
@dataclass(frozen=True)
class Judge:
    """What judges a trial in a process of its own.

    Args:
        code: the mark that the results get.
    """

    code: str = ""

    def __call__(self, trial: Trial) -> Outcome:
        """Make the case, fit and predict."""
        torch.set_num_threads(1)
        case = make(trial.job)
        found = Outcome(trial.job.name, trial.method, case.hidden, code=self.code)
        if trial.method == COST:
            from recipes.studies.versus_sysid import cost

            ours, free, documented, by_hand = cost.seconds(case.task)
            return replace(found, seconds=ours, starts_free=free, reference=documented, by_hand=by_hand)
        return judged(found, case, fitter(trial.method))


def unanswered(trial: Trial, why: str, seconds: float, code: str) -> Outcome:
    """The record of a method that gave no answer."""
    return Outcome(trial.job.name, trial.method, seconds=seconds, ended=why, code=code)


def fitter(method: str) -> Callable[[Task], Fitted]:
    """The ``fit`` of a method's module, which imports what that method needs."""
    module: Any = importlib.import_module(f"{__package__}.{method}")
    fit: Callable[[Task], Fitted] = module.fit
    return fit


def judged(asked: Outcome, case: Case, fit: Callable[[Task], Fitted]) -> Outcome:
    """Fit, predict, score. The base fit and the windows, which all peers share, are nobody's time."""
    task, floor = case.task, floors(case.task)
    if asked.method != "ours":
        task.base_theta, task.fit_windows  # noqa: B018  (made here)
    began = time.process_time()
    fitted = fit(task)
    seconds = time.process_time() - began
    error = in_floors(rms(task.held_windows, fitted.predict(task.held_windows)), floor)
    right, false = scored(case.answers, fitted.claims)
    claims = tuple("|".join(sorted(claim)) for claim in fitted.claims)
    found = replace(asked, claims=claims, right=right, false=false, seconds=seconds)
    return replace(found, error=error) if math.isfinite(error) else replace(found, ended="diverged on held-out runs")


def floors(task: Task) -> Float[Tensor, " S"]:
    """Sensor noise and the starts' uncertainty, as the engineer's nominal model propagates it [SI]."""
    windows, theta = task.held_windows, task.simulator.nominal
    found = start_floor(windows, start_spread(task.simulator, windows, theta), task.signals)
    return torch.tensor([found[signal] for signal in task.signals], dtype=theta.dtype)


def in_floors(error: Float[Tensor, " S"], floor: Float[Tensor, " S"]) -> float:
    """RMS over signals of their errors, each over its floor; inf where one diverged."""
    value = float((error / floor).square().mean().sqrt())
    return value if not math.isnan(value) else math.inf
