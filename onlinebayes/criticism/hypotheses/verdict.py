"""The verdict in one word.

In this order: insufficient_data (nothing moves, or fewer than seven windows do), unexplained where the integrator errs
by too much to judge, and, where what was added takes away half of the squared error above the noise, or all of it:
bounds_exclude_truth (what was added first widens a bound: no law does as well with less), tie (it cannot be told from
another law), bounds_exclude_truth (it frees a number that the model has fixed), missing_effect. Without any, adequate
(no more than the tolerance is left) or unexplained.
"""

from __future__ import annotations

from collections.abc import Mapping

from onlinebayes.criticism.hypotheses.additions import AddedEffect, WiderBounds
from onlinebayes.criticism.hypotheses.explaining import Explanation
from onlinebayes.criticism.hypotheses.ranking import equals
from onlinebayes.criticism.hypotheses.rule import halves
from onlinebayes.criticism.hypotheses.search import AT_FLOOR
from onlinebayes.criticism.results import Verdict
from onlinebayes.identification.results import Numerics

FEWEST_WINDOWS = 7
"""Of motion: fewer tell no law from chance."""


def decide(
    explanation: Explanation,
    numerics: Numerics,
    before: Mapping[str, float],
    after: Mapping[str, float],
    tolerance: float,
) -> Verdict:
    """The first verdict that applies.

    Args:
        explanation: what was found.
        numerics: of the base model.
        before, after: RMS over the floor of the base and the final model, by signal.
        tolerance: RMS over the floor up to which a model is adequate.
    """
    worst, windows = max(after.values(), default=0.0), explanation.windows
    if not bool(windows.observed.any()) or windows.count < FEWEST_WINDOWS:
        return "insufficient_data"
    kept = explanation.found.hypothesis.additions
    if not numerics.sufficient:
        quiet = not kept and worst <= tolerance and numerics.error_at_quarter_step <= 1.0
        return "adequate" if quiet else "unexplained"
    if not kept:
        return "adequate" if worst <= tolerance else "unexplained"
    if not (halves(before.values(), after.values()) or worst <= AT_FLOOR):
        return "unexplained"
    first = kept[0]
    if isinstance(first, WiderBounds):
        return "bounds_exclude_truth"
    if any(equals(found) for found in explanation.rounds if found.added and found.added.addition.key == first.key):
        return "tie"
    return "missing_effect" if isinstance(first, AddedEffect) else "bounds_exclude_truth"
