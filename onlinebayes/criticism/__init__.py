"""Criticism: where a simulator disagrees with measurements, which physical effect is missing, and is it better with it.

Functions on built objects: ``compare``, ``diagnose``, ``refine``; nothing here reads files.
"""

from onlinebayes.criticism.refine import compare, diagnose, refine
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
    WidenedBounds,
)
from onlinebayes.criticism.scope import Scope

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
    "Scope",
    "Selection",
    "Step",
    "WidenedBounds",
    "compare",
    "diagnose",
    "refine",
]
