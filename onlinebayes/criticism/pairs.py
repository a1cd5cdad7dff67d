"""Two effects that are missing at once: one of them can look weak while the other's misfit stands in its way.

A and B are accepted together when each may be added to the model that holds the other: all rules of ``acceptance`` for
B in the model with A, and for A in the model with B. Each of the two tests is one on its own, its p of the maximum over
all candidates included. Tried among the leading ones of a round in which none was admissible alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from onlinebayes.criticism.acceptance import Judged
from onlinebayes.criticism.fit import Fit
from onlinebayes.criticism.results import Numerics, Selection
from onlinebayes.criticism.stage import Stage, refit, run_stage
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect

Added = tuple[Stage, Judged]


def pair(
    stage: Stage, effects: Sequence[Effect], numerics: Numerics, selection: Selection, say: Callable[[str], None]
) -> tuple[Added, Added] | None:
    """The first two effects that need each other, the stronger one first; None where there are none.

    Args:
        stage: a round without an admissible candidate; its judged ones are tried, the best gain first.
        effects: all candidates of that round.
        numerics, selection, say: as of that round.
    """
    for lead in sorted(stage.judged, key=lambda judged: -judged.gain.gain):
        say(f"pairs with {lead.effect.key}")
        beside = _with(lead.fitted, lead.effect, stage, effects, numerics, selection)
        for second in sorted((j for j in beside.judged if j.admissible), key=lambda judged: -judged.gain.gain):
            try:
                alone = refit(stage.current, stage.windows, second.effect, _values(second))
            except BadInput:  # without the other it diverges
                continue
            back = _with(alone, second.effect, stage, effects, numerics, selection)
            first = next((j for j in back.judged if j.admissible and j.effect.key == lead.effect.key), None)
            if first is not None:
                return (stage, lead), (beside, second)
    return None


def _with(
    fitted: Fit, held: Effect, stage: Stage, effects: Sequence[Effect], numerics: Numerics, selection: Selection
) -> Stage:
    """A round on top of the model that holds one effect already."""
    rest = [effect for effect in effects if effect.key != held.key]
    return run_stage(fitted, stage.windows, rest, numerics, selection, lambda _line: None, thorough=False)


def _values(judged: Judged) -> dict[str, float]:
    """The effect's own fitted values, short name -> value [SI]."""
    space = judged.fitted.simulator.parameters
    return {
        name: float(judged.fitted.theta[space.index(f"{judged.effect.key}.{name}")])
        for name in judged.effect.parameters
    }
