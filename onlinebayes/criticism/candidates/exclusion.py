"""How large an effect could be that these data do not show: its exclusion limit.

    one trial:   |size| + max(t se, seen),    seen from |c~|^2 seen^2 = |r|^2 (1 / .95^2 - 1)

size, the least-squares size of what is there without the effect, may have the other sign, so that an effect has to
make up for it first; t se is what the groups' spread leaves possible at 95 %; seen lowers the error by the 5 % that
acceptance asks for. What an effect does may hang on more than its size: a spring whose rest lies far away is a load,
one about the middle of the travel hardly pulls. The limit holds for all of them, so it is that of the values at which
least is seen. Where the size itself is tried at several values, the one next to the limit tells it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from onlinebayes.criticism.candidates.candidates import Trial
from onlinebayes.criticism.judging.acceptance import LEAST_FALL
from onlinebayes.criticism.judging.screening import CONFOUNDED, Scores
from onlinebayes.identification.fitting.blocks import t_quantile
from onlinebayes.simulators.effects import Effect


def exclusion_limit(
    scores: Scores, groups: int, effect: Effect, columns: Sequence[int], tried: Sequence[Trial]
) -> float | None:
    """Smallest distance from neutral that would have been seen [SI of the first parameter].

    Args:
        scores: of all columns, at the windows' own horizon.
        groups: B, that flip together.
        effect: whose limit.
        columns: its columns.
        tried: the trial of each of all columns.

    Returns:
        None where it lies beyond the bounds, or would mean nothing: of an effect that begins at its upper bound (a
        force's limit, which shrinks), and where other values of it do what free parameters can.
    """
    bounds, neutral = effect.parameters[effect.magnitude], effect.neutral[effect.magnitude]
    if groups < 2 or neutral >= bounds.high:
        return None
    alike: dict[tuple[float, ...], list[tuple[float, float]]] = {}
    for k in columns:
        if reach := abs(tried[k].reach):  # else something other than the size makes the trial differ from neutral
            others = tuple(value for name, value in tried[k].values.items() if name != effect.magnitude)
            limit = _limit(scores, groups, k, reach)
            alike.setdefault(others, []).append((abs(math.log(limit / reach)), limit))
    largest = max(min(limits)[1] for limits in alike.values())
    return largest if largest <= max(bounds.high - neutral, neutral - bounds.low) else None


def _limit(scores: Scores, groups: int, column: int, reach: float) -> float:
    """By one trial; infinite where nothing is seen of it beside what is free."""
    norm, g = float(scores.norm[column]), scores.g[:, column]
    if norm <= 0 or float(scores.share[column]) < CONFOUNDED:
        return math.inf
    spread = math.sqrt(groups / (groups - 1) * float((g - g.mean()).square().sum())) / norm
    seen = math.sqrt((1 / (1 - LEAST_FALL) ** 2 - 1) * scores.misfit / norm)
    return reach * (abs(float(scores.size[column])) + max(t_quantile(0.975, groups) * spread, seen))
