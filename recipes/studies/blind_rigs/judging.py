"""One case as a user would meet it: its files are written, loaded and refined; only then is the truth looked at."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import torch

from envs.rigs import BlindCase, case, write_case
from onlinebayes.criticism import BUDGET_S, Candidate, Criticism, names_said, refine, same_as
from onlinebayes.identification import Estimate
from onlinebayes.problems import ProblemFile, load_problem
from onlinebayes.runs import processor_time
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.studies.blind_rigs.names import spelt
from recipes.studies.blind_rigs.plan import Job
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.blind_rigs.truth import in_floors, true_error, true_values
from recipes.studies.spawned import Failed


def judge(job: Job, budget: float = BUDGET_S) -> dict[str, Any]:
    """Make the case, refine it and compare with the truth: the fields of :class:`Judged`.

    Args:
        job: which case.
        budget: processor time after which refine gives the best answer so far [s].

    Raises:
        BadInput: the library refuses the case.
    """
    torch.set_num_threads(1)
    made = case(job.rig, job.kind, job.seed)
    problem = loaded(made)
    began = processor_time()  # one thread: what other work beside the study takes is not counted
    result = refined(problem, budget)
    return asdict(judged(made, problem, result, processor_time() - began))


def unanswered(job: Job, failed: Failed) -> dict[str, Any]:
    """The record of a case that refine gave no answer to."""
    made = case(job.rig, job.kind, job.seed)
    return asdict(replace(_asked(made), ended=failed.problem, seconds=failed.seconds))


def loaded(made: BlindCase) -> ProblemFile:
    """The case's problem from its files, its simulator on one thread: the other processes need the other cores."""
    with tempfile.TemporaryDirectory() as folder:
        problem = load_problem(write_case(made, folder))
    assert isinstance(problem.simulator, MujocoSimulator)
    simulator = MujocoSimulator(problem.simulator.spec, problem.simulator.parameters, threads=1)
    return replace(problem, simulator=simulator)


def refined(problem: ProblemFile, budget: float = BUDGET_S) -> Criticism:
    """Refine a problem with its own settings, within so much processor time [s]."""
    return refine(
        problem.simulator,
        problem.measurement,
        holdout=problem.holdout,
        selection=problem.selection,
        candidates=problem.candidates,
        scope=problem.scope,
        budget_s=budget,
    )


def judged(made: BlindCase, problem: ProblemFile, result: Criticism, seconds: float) -> Judged:
    """The record of a case, without any opinion on it."""
    hidden = _spelt(made)
    first = next((candidate for candidate in result.candidates if candidate.rank == 1), None)
    equal = next((c.indistinguishable_from for c in result.candidates if c.effect in result.accepted[:1]), ())
    accepted = tuple(map(same_as, result.accepted))
    error = result.heldout_error
    truth = true_values(made, result.final.simulator)
    asked = replace(problem, selection=result.selection)
    after, found = in_floors(error.after, error.noise_floor), bool(hidden) and set(accepted) == set(hidden)
    # Where the truth was found, the final model is the reference: no second fit of the same model is needed.
    reference = after if found else true_error(made, asked, result.base.simulator, error.noise_floor)
    # Of a miswired log or of a second's motion the parameters are nobody's.
    meant = made.kind in ("effect", "null") and set(accepted) == set(hidden)
    left = max(result.remainder.rms_over_floor.values(), default=None)
    covered, intervals = _coverage(result, truth) if meant else (0, 0)
    return replace(
        _asked(made),
        verdict=result.verdict,
        accepted=accepted,
        first=same_as(first.effect) if first else "",
        gain=first.score_gain if first else None,
        gain_se=first.score_gain_se if first else None,
        equal=tuple(map(same_as, equal)),
        refused=why_not(result.candidates, hidden),
        widened=tuple(result.widened),
        wiring=result.wiring.fault if result.wiring else "",
        before=in_floors(error.before, error.noise_floor),
        after=after,
        reference=reference,
        beside=_beside(made, asked, result, reference),
        covered=covered,
        intervals=intervals,
        left=left,
        contradicted=tuple(map(same_as, result.contradicted)),
        named=_said(result, left),
        deviations=_deviations(result, truth) if meant else {},
        seconds=seconds,
    )


def _said(result: Criticism, left: float | None) -> tuple[dict[str, Any], ...]:
    """The fields of all that speaks for each name."""
    if result.explanation is None or left is None:
        return ()
    return tuple(map(asdict, names_said(result.explanation, left, result.parameters)))


def _beside(made: BlindCase, problem: ProblemFile, result: Criticism, reference: float | None) -> dict[str, float]:
    """Measure the effect of each of several hidden ones beside the others; nothing of one alone, or without a truth."""
    hidden = _spelt(made)
    if reference is None or len(hidden) < 2:
        return {}
    stepped, floor = result.base.simulator, result.heldout_error.noise_floor
    errors = {key: true_error(made, problem, stepped, floor, without=key) for key in hidden}
    return {key: error / reference for key, error in errors.items() if error is not None}


def _asked(made: BlindCase) -> Judged:
    """The record of a case that nobody has looked at."""
    return Judged(made.rig, made.kind, made.seed, _spelt(made), made.partners, made.level, made.fault)


def _spelt(made: BlindCase) -> tuple[str, ...]:
    return tuple(spelt(key, made.truth) for key in made.hidden)


def why_not(candidates: Sequence[Candidate], hidden: Sequence[str]) -> dict[str, str]:
    """Why each hidden effect was not accepted; nothing for those that were."""
    known = {same_as(candidate.effect): candidate for candidate in reversed(candidates)}
    found = {}
    for key in hidden:
        if key not in known:
            found[key] = "is no candidate"
        elif known[key].confounded_with:
            found[key] = f"confounded with {', '.join(known[key].confounded_with)}"
        elif not known[key].accepted:
            found[key] = _standing(known[key])
    return found


def _standing(candidate: Candidate) -> str:
    gain = "" if candidate.score_gain is None else f", gain {candidate.score_gain:.3g} ± {candidate.score_gain_se:.2g}"
    place = "not ranked" if candidate.rank is None else f"rank {candidate.rank}"
    return f"{place}{gain}: {'; '.join(candidate.refused_because) or 'another went before it'}"


def _given(result: Criticism, truth: Mapping[str, float]) -> dict[str, Estimate]:
    """Estimates that are said to mean something; a number that was found to be off is no nuisance of the truth."""
    known = {name: one for name, one in result.parameters.items() if name in truth and name not in result.accepted}
    return {name: one for name, one in known.items() if one.identifiable}


def _deviations(result: Criticism, truth: Mapping[str, float]) -> dict[str, float]:
    """Return the error of each estimate that is said to mean something, in half widths of its interval."""
    given = _given(result, truth)
    return {name: 2 * (e.mean - truth[name]) / (e.q95 - e.q05) for name, e in given.items() if e.q95 > e.q05}


def _coverage(result: Criticism, truth: Mapping[str, float]) -> tuple[int, int]:
    """Count the 90 % intervals that hold the truth, of those that are said to mean something, and all of those."""
    given = _given(result, truth)
    return sum(e.q05 <= truth[name] <= e.q95 for name, e in given.items()), len(given)
