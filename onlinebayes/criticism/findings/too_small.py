"""Effects that are no chance and yet too small to be accepted: whoever relies on the parameters should know of them.

What lowers the cross-validated error by less than 5 % is not accepted, however sure it is. Fitted parameters may have
taken it up: a load of 52 N m in a boom's weight, its gear and its damping, none of which is then what it says.
"""

from __future__ import annotations

from collections.abc import Sequence

from onlinebayes.criticism.judging.acceptance import LEAST_FALL, TOO_LITTLE
from onlinebayes.criticism.results import Candidate
from onlinebayes.identification import quantities


def too_small_note(candidates: Sequence[Candidate], alpha: float) -> tuple[str, ...]:
    """A sentence that names the surest of them, and how many others there are; nothing without any.

    Args:
        candidates: as ranked.
        alpha: the level at which an effect is significant.
    """
    sure = [one for one in candidates if _surely_small(one, alpha)]
    if not sure:
        return ()
    first = max(sure, key=lambda one: one.score_gain or 0.0)
    sizes = ", ".join(
        f"{name} {quantities.with_error(value.mean, value.sd, value.unit)}" for name, value in first.parameters.items()
    )
    others = f", and {len(sure) - 1} more as sure as that" if len(sure) > 1 else ""
    return (
        f"{first.effect} ({sizes}){others}: hardly chance (p = {first.p_value:.2g}), but it lowers the error by less "
        f"than {100 * LEAST_FALL:g} % and is left out; the fitted parameters may have taken it up, and be further off "
        "than their intervals say",
    )


def _surely_small(candidate: Candidate, alpha: float) -> bool:
    """Whether it was refitted and fails nothing but the fall of the error."""
    reasons = candidate.refused_because
    tested = candidate.p_value is not None and candidate.p_value < alpha and candidate.score_gain is not None
    return tested and len(reasons) == 1 and reasons[0].startswith(TOO_LITTLE)
