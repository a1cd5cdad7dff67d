"""Docstrings as Sphinx reads them: they are plain text with an equation or an example set in, not reStructuredText.

a line that is set in, below a blank line          ->  shown as it is
|x|, (*batch, P), a name that ends in _            ->  those signs, not a substitution, emphasis or a link
``unit``^2                                         ->  a literal that ends although no space follows
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

MARK = re.compile(r"(``[^`]+``|:\w+:`[^`]+`)(?=[\w^])|(``[^`]+``|:\w+:`[^`]+`)|([|*]|(?<=\w)_+(?!\w))")
"""A literal without an end, what is left as it is, or a sign that would be taken for markup."""


def as_sphinx_reads_them(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Rewrite the lines of a docstring in place."""
    lines[:] = reread(lines)


def reread(lines: list[str]) -> list[str]:
    """Return the lines with what is set in below a blank line as a literal block, and without accidental markup."""
    out: list[str] = []
    shown = False
    for number, line in enumerate(lines):
        set_in = line.startswith("  ")
        if line.strip():
            begins = set_in and number > 0 and not lines[number - 1].strip()
            if begins and not shown and not _heads_a_section(lines[:number]):
                out += ["::", ""]
                shown = True
            shown = shown and set_in
        out.append(line if shown else MARK.sub(_escaped, line))
    return out


def _escaped(found: re.Match[str]) -> str:
    if found[1]:
        return found[1] + "\\ "
    return found[2] or "\\" + found[3]


def _heads_a_section(before: list[str]) -> bool:
    """Does a section such as ``Args:`` go on: the last line that is not set in is its head."""
    heads = [line for line in before if line.strip() and not line.startswith(" ")]
    return bool(heads) and re.fullmatch(r"[A-Z][a-z]+:", heads[-1]) is not None
