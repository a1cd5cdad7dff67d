"""The verdict in one word.

In this order: insufficient_data (nothing moves, or fewer than seven windows do); unexplained where the integrator errs
by as much as was explained, where the held-out runs contradict what was added, or where that leaves more than half of
the squared error above the noise; bounds_exclude_truth (what was added first widens a bound: no law does as well with
less), tie (it cannot be told from another law), bounds_exclude_truth (it frees a number that the model has fixed),
missing_effect. Without any addition, adequate (no more than the tolerance is left) or unexplained.
"""

from __future__ import annotations

from collections.abc import Mapping

from onlinebayes.criticism.hypotheses.additions import AddedEffect, OwnValues, WiderBounds
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.ranking import equals
from onlinebayes.criticism.results import Verdict
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.judging.evaluator import AT_FLOOR
from onlinebayes.identification.judging.rule import EXPLAINED, half_gone
from onlinebayes.identification.results import Numerics
from onlinebayes.measurements import Measurement

FEWEST_WINDOWS = 7
"""Of motion, of the length asked for: fewer tell no law from chance. So many separate runs do as well."""


def decide(
    explanation: Explanation,
    numerics: Numerics,
    before: Mapping[str, float],
    after: Mapping[str, float],
    tolerance: float,
    enough: bool,
    doubted: bool,
) -> Verdict:
    """The first verdict that applies.

    Args:
        explanation: what was found.
        numerics: of the base model.
        before, after: RMS over the floor of the base and the final model, by signal.
        tolerance: RMS over the floor up to which a model is adequate.
        enough: whether the data are, see :func:`what_to_record`.
        doubted: whether what was found is not to be relied on, see :mod:`..findings.doubts`.
    """
    worst = max(after.values(), default=0.0)
    if not enough:
        return "insufficient_data"
    kept = explanation.found.hypothesis.additions
    if not kept:
        fine = numerics.sufficient or numerics.error_at_quarter_step <= 1.0
        return "adequate" if worst <= tolerance and fine else "unexplained"
    if not numerics.sufficient and not _more_than_the_step(numerics.error_at_quarter_step, before, after):
        return "unexplained"
    if doubted or not (half_gone(before.values(), after.values()) or worst <= AT_FLOOR):
        return "unexplained"
    named = [one for one in kept if not isinstance(one, OwnValues)]
    if not named:
        return "unexplained"  # one value for all runs is not enough: nothing is missing, and the model does not agree
    first = named[0]
    if isinstance(first, WiderBounds):
        return "bounds_exclude_truth"
    if any(equals(found) for found in explanation.rounds if found.added and found.added.addition.key == first.key):
        return "tie"
    return "missing_effect" if isinstance(first, AddedEffect) else "bounds_exclude_truth"


def _more_than_the_step(error: float, before: Mapping[str, float], after: Mapping[str, float]) -> bool:
    """Check whether what was added explains far more than the integrator errs by: its name then holds at any step.

    Args:
        error: of the integrator [floors]; not a number where it is not known.
        before, after: as in :func:`decide`.
    """
    gone = max((before[name] ** 2 - value**2 for name, value in after.items()), default=0.0)
    return error**2 <= (1 - EXPLAINED) * gone


def what_to_record(windows: Windows, runs: Measurement, horizon: float) -> str:
    """Say in one sentence what would make the data enough; empty where they are.

    Args:
        windows: on which the search judged.
        runs: the fit runs.
        horizon: length of the windows that errors are reported over [s].
    """
    if not bool(windows.observed.any()):
        return (
            "record runs in which the joints move: nothing here moves by more than 8 standard deviations of its sensor"
        )
    seconds, needed = sum(runs.durations), FEWEST_WINDOWS * horizon
    if windows.count >= FEWEST_WINDOWS and (seconds >= needed or len(runs.runs) >= FEWEST_WINDOWS):
        return ""
    return (
        f"record at least {needed:.3g} s of motion to fit, or at least {FEWEST_WINDOWS} separate runs: these data hold "
        f"{seconds:.3g} s in {len(runs.runs)}, too little to tell a law from chance"
    )
