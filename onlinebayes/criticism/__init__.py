"""Model criticism: a simulator is fitted to measured runs, the misfit is located, and a missing effect is identified.

``compare`` fits and locates the misfit, ``diagnose`` ranks the physical effects that could explain it, ``refine`` adds
them until the model predicts held-out runs as well as it can. All take built objects; nothing here reads files.
"""

from onlinebayes.criticism.candidates.candidates import Trial, grown, grown_theta, propose, trials
from onlinebayes.criticism.candidates.scales import target_scales
from onlinebayes.criticism.checking import FALSE_ALARMS, Change, Check, Drift, check
from onlinebayes.criticism.commands import BUDGET_S, compare, diagnose, refine
from onlinebayes.criticism.criticism import Criticism
from onlinebayes.criticism.experiment import Allowed, Payload, Plan, Rivalry, Tried, next_experiment
from onlinebayes.criticism.findings.named import Named, evidence, names_said, probability
from onlinebayes.criticism.hypotheses.additions import wider_bounds
from onlinebayes.criticism.hypotheses.explanation import (
    SCALES_HORIZON,
    Explanation,
    additions,
    explanation_of,
    flexible,
)
from onlinebayes.criticism.hypotheses.kept_fit import kept_fit
from onlinebayes.criticism.hypotheses.ranking import equals, same_as
from onlinebayes.criticism.hypotheses.search import Search
from onlinebayes.criticism.hypotheses.weighing import MOST_HYPOTHESES
from onlinebayes.criticism.mixture import ModelMixture, joined, mixture_of, moments_of, worlds_of
from onlinebayes.criticism.prepared_log import PreparedLog, prepare
from onlinebayes.criticism.reading import begun_as_read
from onlinebayes.criticism.results import (
    MOVES_NOTHING,
    Candidate,
    DelayPlace,
    DelayRecording,
    DelayStage,
    DriftSeen,
    Failure,
    HeldOutError,
    LocatedDelay,
    ParameterChange,
    Question,
    Remainder,
    Step,
    Verdict,
    WeightedModel,
    WidenedBounds,
    Wiring,
)
from onlinebayes.criticism.timing import Timing
from onlinebayes.criticism.unit_prior import next_unit
from onlinebayes.identification.detail import Detail, HorizonError, Profile, WindowError
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fleet import Fleet
from onlinebayes.identification.judging.evaluator import Evaluation, FitRequest
from onlinebayes.identification.judging.held_out import held_out_errors, run_scores
from onlinebayes.identification.judging.hypothesis import Addition, Hypothesis
from onlinebayes.identification.replaying.scoped import unscoped
from onlinebayes.identification.results import Estimate, FittedModel, FlatDirection, Numerics, ReplayedRun, Selection
from onlinebayes.identification.scope import Scope

__all__ = [
    "BUDGET_S",
    "FALSE_ALARMS",
    "MOST_HYPOTHESES",
    "MOVES_NOTHING",
    "SCALES_HORIZON",
    "Addition",
    "Allowed",
    "Candidate",
    "Change",
    "Check",
    "Criticism",
    "DelayPlace",
    "DelayRecording",
    "DelayStage",
    "Detail",
    "Drift",
    "DriftSeen",
    "Estimate",
    "Evaluation",
    "Explanation",
    "Failure",
    "FitRequest",
    "FittedModel",
    "FlatDirection",
    "Fleet",
    "HeldOutError",
    "HorizonError",
    "Hypothesis",
    "LocatedDelay",
    "ModelMixture",
    "Named",
    "Numerics",
    "ParameterChange",
    "Payload",
    "Plan",
    "PreparedLog",
    "Profile",
    "Question",
    "Remainder",
    "ReplayedRun",
    "Rivalry",
    "Scope",
    "Search",
    "Selection",
    "Step",
    "Timing",
    "Trial",
    "Tried",
    "Verdict",
    "WeightedModel",
    "WidenedBounds",
    "WindowError",
    "Wiring",
    "additions",
    "begun_as_read",
    "check",
    "compare",
    "diagnose",
    "equals",
    "evidence",
    "explanation_of",
    "fit",
    "flexible",
    "grown",
    "grown_theta",
    "held_out_errors",
    "joined",
    "kept_fit",
    "mixture_of",
    "moments_of",
    "names_said",
    "next_experiment",
    "next_unit",
    "prepare",
    "probability",
    "propose",
    "refine",
    "run_scores",
    "same_as",
    "target_scales",
    "trials",
    "unscoped",
    "wider_bounds",
    "worlds_of",
]
