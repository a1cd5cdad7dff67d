"""Why what was found is not to be relied on, a sentence each: then the verdict is that the misfit is unexplained.

    S_held(base) - S_held(h) >= 0.05 nats,     see :mod:`.contradicted`

It is the rule's least gain, asked of the runs that nobody has looked at.
"""

from __future__ import annotations

from collections.abc import Iterator

from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.ranking import laws
from onlinebayes.identification.judging.rule import LEAST_GAIN
from onlinebayes.identification.judging.skill import gains_with_skill, unskilled


def doubts(explanation: Explanation, gain: float) -> Iterator[str]:
    """Doubts of a hypothesis that adds something; nothing of others.

    Args:
        explanation: what the fit runs say.
        gain: over the held-out runs [nats]; not a number where it is not known.
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
    if gain < LEAST_GAIN:
        yield f"the held-out error does not fall with {named}: do not rely on that"
