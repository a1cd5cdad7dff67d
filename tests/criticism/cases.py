"""A case of the blind rigs, refined as its problem file says."""

from __future__ import annotations

from pathlib import Path

from envs.rigs import case, write_case
from onlinebayes.criticism import Criticism, refine
from onlinebayes.problems import load_problem


def refined(rig: str, kind: str, seed: int, folder: Path) -> tuple[Criticism, list[str]]:
    """What refine says of the case, and its lines of progress."""
    problem, stages = load_problem(write_case(case(rig, kind, seed), folder)), []
    result = refine(
        problem.simulator,
        problem.measurement,
        holdout=problem.holdout,
        selection=problem.selection,
        candidates=problem.candidates,
        progress=stages.append,
    )
    return result, stages
