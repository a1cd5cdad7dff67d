"""What one method made of one case: its error, what it claimed, what it took.

Errors are RMS over the held-out windows, each signal over its floor, then RMS over signals. The floor is that of
criticism's held-out error at the engineer's nominal parameters, so that it belongs to no method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from recipes.studies.blind_rigs.names import Answer
from recipes.studies.json_line import parsed
from recipes.studies.versus_sysid.task import Claim

METHODS = ("base", "ours", "sysid")
COST = "cost"
"""No method: the same parameters fitted to the same windows by criticism and by ``mujoco.sysid``."""


@final
@dataclass(frozen=True)
class Outcome:
    """A method on a case.

    Args:
        case, method: which.
        hidden: the right names.
        error: held-out [floors]; None where there is no answer.
        claims: names, twins joined by ``|``.
        right: how many of the hidden effects were named.
        false: how many claims name nothing that is hidden.
        seconds: processor time of the fit [s].
        reference, by_hand, starts_free: of ``cost``, the processor time of ``mujoco.sysid`` as documented, by hand, and
            with the windows' starts free, too [s].
        ended: empty, or why there is no answer.
        code: which code it was.
    """

    case: str
    method: str
    hidden: tuple[str, ...] = ()
    error: float | None = None
    claims: tuple[str, ...] = ()
    right: int = 0
    false: int = 0
    seconds: float = 0.0
    reference: float | None = None
    by_hand: float | None = None
    starts_free: float | None = None
    ended: str = ""
    code: str = ""

    @property
    def name(self) -> str:
        """``case.method``."""
        return f"{self.case}.{self.method}"


def scored(answers: Sequence[Answer], claims: Sequence[Claim]) -> tuple[int, int]:
    """(hidden effects that were named, claims that name nothing hidden)."""
    said = frozenset[str]().union(*claims)
    right = sum(answer.found(said) for answer in answers)
    return right, sum(not any(answer.admits(key) for answer in answers for key in claim) for claim in claims)


def from_json(text: str) -> Outcome:
    """The outcome of a line that :func:`~recipes.studies.json_line.line` made.

    Raises:
        ValueError: it is none.
    """
    return parsed(
        Outcome, text, lambda raw: raw.get("method") in (*METHODS, COST) and "case" in raw, "outcome of the comparison"
    )
