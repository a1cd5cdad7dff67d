"""One method on one case, judged by the same windows and names as every other.

Errors are RMS over the held-out windows, each signal over its floor, then RMS over signals. The floor is that of
criticism's held-out error at the engineer's nominal parameters, so that it belongs to no method.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, final

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import start_floor, start_spread
from onlinebayes.runs import processor_time
from recipes.studies.blind_rigs.names import Answer
from recipes.studies.blind_rigs.plan import Job
from recipes.studies.spawned import Failed
from recipes.studies.versus_sysid.cases import Case, make
from recipes.studies.versus_sysid.methods import METHODS
from recipes.studies.versus_sysid.task import Claim, Fitted, Task, rms

COST = "cost"
"""No method: the same parameters and starts fitted to the same windows by criticism and by ``mujoco.sysid``."""

Trial = tuple[Job, str]
"""A case, and the method that is tried on it."""


@final
@dataclass(frozen=True)
class Outcome:
    """Result of one method on one case.

    Args:
        case, method: which.
        hidden: the right names.
        error: held-out [floors]; None where there is no answer.
        claims: names, twins joined by ``|``.
        right: how many of the hidden effects were named.
        false: how many claims name nothing that is hidden.
        seconds: processor time of the fit [s].
        reference: of ``cost``, the processor time of ``mujoco.sysid`` [s].
        ended: empty, or why there is no answer.
    """

    case: str
    method: str
    hidden: tuple[str, ...] = ()
    error: float | None = None
    claims: tuple[str, ...] = ()
    right: int = 0
    false: int = 0
    seconds: float = 0.0
    reference: float | None = None
    ended: str = ""


def tried(trial: Trial) -> dict[str, Any]:
    """Make the case, fit and predict: the fields of :class:`Outcome`."""
    torch.set_num_threads(1)
    job, method = trial
    case = make(job)
    found = Outcome(job.name, method, case.hidden)
    if method == COST:
        from recipes.studies.versus_sysid.cost import seconds

        ours, theirs = seconds(case.task)
        return asdict(replace(found, seconds=ours, reference=theirs))
    return asdict(judged(found, case, METHODS[method]))


def unanswered(trial: Trial, failed: Failed) -> dict[str, Any]:
    """The record of a method that gave no answer."""
    return asdict(Outcome(trial[0].name, trial[1], seconds=failed.seconds, ended=failed.problem))


def judged(asked: Outcome, case: Case, fit: Callable[[Task], Fitted]) -> Outcome:
    """Fit, predict, score. The base fit and the windows, which all peers share, are nobody's time."""
    task, floor = case.task, floors(case.task)
    if asked.method != "ours":
        task.base_theta, task.fit_windows  # noqa: B018  (made here)
    began = processor_time()
    fitted = fit(task)
    seconds = processor_time() - began
    error = float((rms(task.held_windows, fitted.predict(task.held_windows)) / floor).square().mean().sqrt())
    right, false = scored(case.answers, fitted.claims)
    claims = tuple("|".join(sorted(claim)) for claim in fitted.claims)
    found = replace(asked, claims=claims, right=right, false=false, seconds=seconds)
    return replace(found, error=error) if math.isfinite(error) else replace(found, ended="diverged on held-out runs")


def scored(answers: Sequence[Answer], claims: Sequence[Claim]) -> tuple[int, int]:
    """(hidden effects that were named, claims that name nothing hidden)."""
    said = frozenset[str]().union(*claims)
    right = sum(answer.found(said) for answer in answers)
    return right, sum(not any(answer.admits(key) for answer in answers for key in claim) for claim in claims)


def floors(task: Task) -> Float[Tensor, " S"]:
    """Sensor noise and the starts' uncertainty, as the engineer's nominal model propagates it [SI]."""
    windows, theta = task.held_windows, task.simulator.nominal
    found = start_floor(windows, start_spread(task.simulator, windows, theta), task.signals)
    return torch.tensor([found[signal] for signal in task.signals], dtype=theta.dtype)
