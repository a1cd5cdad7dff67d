"""Model criticism: a simulator is fitted to measured runs, the misfit is located, and a missing effect is identified.

``compare`` fits and locates the misfit, ``diagnose`` ranks the physical effects that could explain it, ``refine`` adds
them until the model predicts held-out runs as well as it can. All take built objects; nothing here reads files.
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
    ParameterChange,
    Remainder,
    ReplayedRun,
    Selection,
    Step,
    Verdict,
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
    "ParameterChange",
    "Profile",
    "Remainder",
    "ReplayedRun",
    "Scope",
    "Selection",
    "Step",
    "Timing",
    "Verdict",
    "WidenedBounds",
    "WindowError",
    "Wiring",
    "compare",
    "diagnose",
    "refine",
]
