"""Criticism: where a simulator disagrees with measurements, which physical effect is missing, and is it better with it.

Functions on built objects: ``compare``, ``diagnose``, ``refine``; nothing here reads files.
"""

from onlinebayes.criticism.detail import Detail, HorizonError, Profile, WindowError
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
    Wiring,
)
from onlinebayes.criticism.scope import Scope
from onlinebayes.criticism.timing import Timing

__all__ = [
    "Candidate",
    "Criticism",
    "Detail",
    "Estimate",
    "Failure",
    "FittedModel",
    "FlatDirection",
    "HeldOutError",
    "HorizonError",
    "Numerics",
    "Profile",
    "Remainder",
    "ReplayedRun",
    "Scope",
    "Selection",
    "Step",
    "Timing",
    "WidenedBounds",
    "WindowError",
    "Wiring",
    "compare",
    "diagnose",
    "refine",
]
