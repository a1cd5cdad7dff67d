"""One effect of a known size, put into a record that excludes less than that: was it found.

size = 1.5 × exclusion limit,      the limit from the same record (commands, base parameters, noise) without the effect
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import final

from envs.rigs import RIGS
from recipes.studies.blind_rigs.names import answer
from recipes.studies.json_line import parsed

TIMES = 1.5


@final
@dataclass(frozen=True)
class Probe:
    """An effect that was put into a record, and what refine said.

    Args:
        rig, seed: which record.
        effect: as the library spells it.
        limit: the size of its first parameter that the record without it excludes [that unit].
        verdict, accepted: what refine said with it.
        first: the candidate ranked first.
        equal: what the first accepted effect cannot be told from.
        refused: why the effect was not accepted.
        seconds: of processor time that refine took [s].
        code: which code it was.
    """

    rig: str
    seed: int
    effect: str
    limit: float = 0.0
    verdict: str = ""
    accepted: tuple[str, ...] = ()
    first: str = ""
    equal: tuple[str, ...] = ()
    refused: str = ""
    seconds: float = 0.0
    code: str = ""

    @property
    def name(self) -> str:
        """``rig-effect-seed``."""
        return f"{self.rig}-{self.effect}-{self.seed}"

    @property
    def found(self) -> bool:
        """Whether the effect, or what looks like it on this rig, was accepted or is said to be tied with what was."""
        right = answer(self.rig, self.effect)
        return right.found(self.accepted) or right.found(self.equal)


@final
@dataclass(frozen=True)
class Record:
    """One record: what was refined without any effect, and then with each of several.

    Args:
        rig, seed: which.
        verdict: of the record with nothing in it.
        limited: how many of the rig's effects have a limit there.
        unlimited: those that have none, as the library spells them.
        probes: the effects that were put into it.
        ended: empty, or why there is no answer.
    """

    rig: str
    seed: int
    verdict: str = ""
    limited: int = 0
    unlimited: tuple[str, ...] = ()
    probes: tuple[Probe, ...] = ()
    ended: str = ""

    @property
    def name(self) -> str:
        """``rig-limits-seed``, its job's name."""
        return f"{self.rig}-limits-{self.seed}"


def from_json(text: str) -> Record:
    """The record of a line that :func:`~recipes.studies.json_line.line` made.

    Raises:
        ValueError: it is none.
    """
    record = parsed(Record, text, lambda raw: raw.get("rig") in RIGS and "probes" in raw, "record of limits")
    return replace(record, probes=tuple(_probe(raw) for raw in record.probes))


def _probe(raw: object) -> Probe:
    return parsed(Probe, json.dumps(raw), lambda probe: "effect" in probe, "probe")
