"""Two effects that are missing at once: one of them can look weak while the other's misfit stands in its way.

A and B are accepted together when each may be added to the model that holds the other: all rules of ``acceptance`` for
B in the model with A, and for A in the model with B. Each of the two tests is one on its own, its p of the maximum over
all candidates included. Tried among the leading ones of a round in which none was admissible alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from onlinebayes.criticism.acceptance import STANDARD_ERRORS, Judged
from onlinebayes.criticism.fit import Fit
from onlinebayes.criticism.results import Numerics, Selection
from onlinebayes.criticism.score import score_gain
from onlinebayes.criticism.stage import Stage, refit, run_stage
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect

Added = tuple[Stage, Judged]


def pair(
    stage: Stage, effects: Sequence[Effect], numerics: Numerics, selection: Selection, say: Callable[[str], None]
) -> tuple[Added, Added] | None:
    """The two effects that need each other and predict best together, the stronger one first; None without any.

    Of the pairs within two paired standard errors of the best the one with the fewest parameters, as for single
    effects: a spring with a far rest position can stand for a constant load.

    Args:
        stage: a round without an admissible candidate; its judged ones are tried, the best gain first.
        effects: all candidates of that round.
        numerics, selection, say: as of that round.
    """
    found: dict[frozenset[str], tuple[Added, Added]] = {}
    for lead in sorted(stage.judged, key=lambda judged: -judged.gain.gain):
        say(f"pairs with {lead.effect.key}")
        beside = _with(lead.fitted, lead.effect, stage, effects, numerics, selection)
        for second in (judged for judged in beside.judged if judged.admissible):
            both = frozenset((lead.effect.key, second.effect.key))
            if both not in found and _needs(stage, lead, second, effects, numerics, selection):
                found[both] = ((stage, lead), (beside, second))
    if not found:
        return None
    step = stage.windows.bin_step
    best = max(found.values(), key=lambda pair: score_gain(pair[1][1].scores, stage.scores, step).gain)

    def close(other: tuple[Added, Added]) -> bool:
        ahead = score_gain(best[1][1].scores, other[1][1].scores, step)
        return ahead.gain <= STANDARD_ERRORS * ahead.se

    return min((other for other in found.values() if close(other)), key=_size)


def _needs(
    stage: Stage,
    lead: Judged,
    second: Judged,
    effects: Sequence[Effect],
    numerics: Numerics,
    selection: Selection,
) -> bool:
    """Whether the model that holds ``second`` alone admits ``lead``."""
    try:
        alone = refit(stage.current, stage.windows, second.effect, _values(second))
    except BadInput:  # without the other it diverges
        return False
    back = _with(alone, second.effect, stage, effects, numerics, selection)
    return any(judged.admissible and judged.effect.key == lead.effect.key for judged in back.judged)


def _size(pair: tuple[Added, Added]) -> int:
    return sum(len(judged.effect.parameters) for _, judged in pair)


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
