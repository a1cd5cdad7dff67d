"""Criticism: where a simulator disagrees with measurements, which physical effect is missing, and is it better with it.

Public signatures (simulator and measurement are built objects; nothing here reads files):

    compare(simulator, measurement, *, holdout=None, selection=Selection(), progress=None) -> Criticism
    diagnose(simulator, measurement, *, holdout=None, selection=Selection(), candidates="all", progress=None, interrupt=None)
    refine(simulator, measurement, *, holdout=None, selection=Selection(), candidates="all", progress=None, interrupt=None)

``holdout`` names runs (None: the last third of the runs, or of the only run's time); ``candidates`` is ``"all"`` or
a sequence of effect names, ``name@target`` keys or :class:`Effect` objects; ``progress`` is called with one line of text
between stages; ``interrupt`` (:class:`onlinebayes.runs.Interrupt`) stops the search between stages.
"""

from onlinebayes.criticism.results import (
    Candidate,
    Criticism,
    Estimate,
    Failure,
    FittedModel,
    FlatDirection,
    HeldOutError,
    Numerics,
    Remainder,
    ReplayedRun,
    Selection,
    Step,
)

__all__ = [
    "Candidate",
    "Criticism",
    "Estimate",
    "Failure",
    "FittedModel",
    "FlatDirection",
    "HeldOutError",
    "Numerics",
    "Remainder",
    "ReplayedRun",
    "Selection",
    "Step",
]
