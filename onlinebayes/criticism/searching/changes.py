"""A parameter that differs between runs, taken into the model in place of an effect.

It enters beside an admissible effect only where it predicts better by two paired standard errors and leaves no more
than noise; where no effect is admissible it must remove half of the squared error above the floor, or reach the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from onlinebayes.criticism.candidates.candidates import grown
from onlinebayes.criticism.judging.acceptance import Judged
from onlinebayes.criticism.judging.verdict import AT_FLOOR, halved, left_over
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.per_run_parameters import Differing, beats, find_differing, with_own_values
from onlinebayes.criticism.searching.stage import Stage
from onlinebayes.identification.fitting.numerics import Grounds, settle
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable


@dataclass(frozen=True)
class Changed:
    """A parameter with a value of its own in every run.

    Args:
        simulator: the base model with these values, at its own step.
        judged: what was found.
        equals: other parameters whose own values are admissible and predict as well.
        grounds: the model with the accepted effects and these values, fitted.
        noise: whether it leaves no more than noise.
        halved: whether it removes half of the squared error above the floor, or reaches it.
    """

    simulator: Identifiable
    judged: Differing
    equals: tuple[str, ...]
    grounds: Grounds
    noise: bool
    halved: bool


def find_change(
    simulator: Identifiable,
    context: SearchContext,
    current: Grounds,
    stage: Stage,
    effects: Sequence[Effect],
    rival: Judged | None,
) -> Changed | None:
    """The parameter whose own values explain what is left, if one's do and no admissible effect does as well.

    Args:
        simulator: the base model at its own step.
        context: of the search.
        current: the model as it stands.
        stage: its round of effects.
        effects: the accepted ones.
        rival: the admissible effect that would be added instead; None without any.
    """
    measurement, selection = context.measurement, context.selection
    found = find_differing(current.fitted, current.windows, stage, measurement.runs, selection)
    admissible = [one for one in found if not one.failed]
    if not admissible:
        return None
    best, step = admissible[0], current.windows.bin_step
    if rival is not None and not beats(best, rival.scores, step):
        return None
    own = with_own_values(simulator, measurement.runs, best.address)
    model, noise = grown(own, effects), current.windows.noise
    settled = settle(model, measurement, selection.horizon_s, noise, best.fitted.theta, current, best.fitted)
    before, after = (left_over(grounds) for grounds in (current, settled))
    worst = max(after.values(), default=0.0)
    equals = tuple(one.address for one in admissible[1:] if not beats(best, one.scores, step))
    enough = worst <= AT_FLOOR or halved(before, after)
    return Changed(own, best, equals, settled, worst <= selection.tolerance, enough)
