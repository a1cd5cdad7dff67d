"""Are actuators late on a machine that was idle before its runs? Asked before anything else is tried.

The question is whether any delay or lag explains much with no command before the runs, and far more than with the first
row's command held before them. Without it a motor that is late by whole rows passes for a column that was logged late,
as a log that is read late needs no commands before its runs.
"""

from __future__ import annotations

import math
from dataclasses import replace

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.candidates.survey import Screened, survey
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import enough_motion
from onlinebayes.criticism.searching.stage import MUCH_PROMISED, refit
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.as_run import far_better
from onlinebayes.identification.fitting.before_runs import commanded_at_once, remembers_commands, reread
from onlinebayes.identification.fitting.numerics import Grounds
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.runs import BadInput

RIVALS = 2
"""So many are refitted: to first order a lag and a delay of one actuator are the same."""


def late_from_idle(base: Grounds, context: SearchContext) -> bool:
    """Whether a late actuator explains far more of the misfit where no command was given before the runs.

    Args:
        base: the base model fitted, the first rows' commands held before the runs.
        context: of the search.
    """
    fit_runs, tolerance = context.measurement, context.selection.tolerance
    model, left = base.fitted.simulator, misfit(base.fitted.projected)
    if left <= tolerance or not commanded_at_once(fit_runs) or remembers_commands(model):
        return False
    if not enough_motion(base, context.selection):
        return False
    proposed = propose(model, base.windows, context.candidates)
    late = [effect for effect in proposed if effect.has_command and effect.memory > 0]
    if not late:
        return False
    idle = reread(base, replace(fit_runs, idle_before=True)).windows
    found = survey(base.fitted, idle, late, context.selection.folds).screened
    leading = sorted(found, key=lambda one: -one.promise)[:RIVALS]
    explained, best = min(
        ((_left(base, idle, one), k) for k, one in enumerate(leading) if one.promise >= MUCH_PROMISED),
        default=(math.inf, 0),
    )
    if explained > (1 - MUCH_PROMISED) * left:
        return False
    held = _left(base, base.windows, leading[best])
    return held > tolerance and explained <= far_better(held)


def _left(base: Grounds, windows: Windows, late: Screened) -> float:
    """What the base model leaves with a late actuator, over windows read one way [floors]."""
    try:
        fitted, _ = refit(base.fitted, windows, late.effect, late.start, math.inf, late.others, late.promise)
    except BadInput:  # it diverges from where screening would start it
        return math.inf
    return misfit(fitted.projected)
