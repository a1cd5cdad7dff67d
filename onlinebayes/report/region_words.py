"""Regions of the data in plain words: ``|qvel.arm| < 0.04 rad/s`` -> ``where arm is slower than 0.04 rad/s``."""

from __future__ import annotations

import re
from typing import Final

_PATTERNS: Final = (
    (r"\|qvel\.(.+)\| < (.+)", r"where \1 is slower than \2"),
    (r"\|qvel\.(.+)\| > (.+)", r"where \1 is faster than \2"),
    (r"qvel\.(.+) > 0", r"where \1 moves forward"),
    (r"qvel\.(.+) < 0", r"where \1 moves backward"),
    (r"qpos\.(.+) < (.+)", r"where \1 is below \2"),
    (r"qpos\.(.+) > (.+)", r"where \1 is above \2"),
    (r"\|ctrl\.(.+)\| > (.+)", r"where the command of \1 is larger than \2"),
    (r"run '(.+)'", r"in run “\1”"),
    (r"time since the run's start < (.+)", r"in the first \1 of a run"),
    (r"time since the run's start > (.+)", r"later than \1 after a run's start"),
    (r"the (first|middle|last) third of the time", r"in the \1 third of the time"),
)


def in_words(where: str) -> str:
    """The region in words; as it is where it has another form."""
    for pattern, words in _PATTERNS:
        if found := re.fullmatch(pattern, where):
            return found.expand(words)
    return where
