"""Why what was found is not to be relied on, a sentence each: then the verdict is that the misfit is unexplained.

    held-out gain = sum over signals of 1/2 log((before^2 + 1) / (after^2 + 1)) >= 0.05,     errors in noise floors

It is the rule's least gain, asked of the runs that nobody has looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.ranking import laws
from onlinebayes.criticism.results import HeldOutError
from onlinebayes.identification.judging.rule import LEAST_GAIN
from onlinebayes.identification.judging.skill import gains_with_skill, unskilled


def doubts(explanation: Explanation, error: HeldOutError) -> Iterator[str]:
    """Doubts of a hypothesis that adds something; nothing of others.

    Args:
        explanation: what the fit runs say.
        error: over the held-out runs.
    """
    found, base, evaluator = explanation.found, explanation.base, explanation.evaluator
    named = " and ".join(laws(found.hypothesis))
    if not named:
        return
    if not gains_with_skill(found, base, evaluator):
        signals = " and ".join(unskilled(found, evaluator))
        yield (
            f"the model's replay of {signals} is no better than going on at the last velocity: {named} cannot be "
            "named from that; check the model, or record at a higher rate"
        )
    if held_out_gain(error) < LEAST_GAIN:
        yield f"the held-out error does not fall with {named}: do not rely on that"


def held_out_gain(error: HeldOutError) -> float:
    """Compute the gain of the final model over the base model on the held-out runs [nats]; nan without any row."""
    parts = []
    for signal, floor in error.noise_floor.items():
        before, after = (one[signal] / floor for one in (error.before, error.after))
        if not math.isnan(before + after):
            parts.append(score_of(before) - score_of(after) if before != after else 0.0)
    return sum(parts) if parts else math.nan


def score_of(error: float) -> float:
    """A signal's part of the score S, of its RMS in floors [nats]."""
    return 0.5 * math.log1p(error**2)
