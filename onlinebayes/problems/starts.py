"""``[starts]`` of a problem file -> what is known of the state in which every run begins.

"qvel.*" = 0.0                                  at rest
"qpos.lift" = { value = 0.12, sd = 0.002 }      put down there by hand
"qvel.wheel" = { sd = 0.3 }                     every window begins within 0.3 rad/s of what was measured
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from onlinebayes.measurements import KnownStart
from onlinebayes.problems.section import Section
from onlinebayes.runs import nearest


def known_starts(section: Section, coordinates: Sequence[str]) -> dict[str, KnownStart]:
    """Coordinate -> what is known of it.

    Args:
        section: ``[starts]``, numbers or tables by names or globs of coordinates.
        coordinates: those of the model, ``qpos.<joint>`` and ``qvel.<joint>``.

    Raises:
        BadInput: a name that matches no coordinate, two that match one, or no value and no sd.
    """
    found: dict[str, KnownStart] = {}
    written: dict[str, str] = {}
    for pattern in section.values:
        matched = [name for name in coordinates if name == pattern or fnmatchcase(name, pattern)]
        if not matched:
            raise section.error(pattern, "the model has no such coordinate", nearest(pattern, coordinates, listed=12))
        known = _known(section, pattern)
        for name in matched:
            if name in found:
                problem = f"'{name}' is told by '{written[name]}' already"
                raise section.error(pattern, problem, "let one entry match each coordinate")
            found[name], written[name] = known, pattern
    return found


def _known(section: Section, pattern: str) -> KnownStart:
    """Read one entry; a number alone is a value that is known exactly."""
    if not isinstance(section.values[pattern], dict):
        return KnownStart(section.number(pattern))
    table = section.section(pattern, ("value", "sd"))
    with section.at(pattern):
        return KnownStart(table.number("value"), table.number("sd", 0.0) or 0.0)
