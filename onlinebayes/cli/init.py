"""``onlinebayes init model.xml log.csv --out problem.toml``: a first problem file, to be read and edited.

What is in it: :mod:`.first_draft`. What could not be matched stands in the file as a comment and is printed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from onlinebayes.cli.outputs import check_apart
from onlinebayes.problems.drafting import Draft, Match, cure, doubt, draft, held, weld_of
from onlinebayes.runs import BadInput, Stages, one_line, write_atomic

NUMBER = re.compile(r"\d+")

MANY = 8
"""Numbered columns of one kind that are said in one line."""


def init(model: str, logs: Sequence[str], out: str, force: bool = False) -> int:
    """Write the file and print what was matched and what was not; returns the exit status.

    Args:
        model: path of an MJCF file.
        logs: paths of tables, at least one.
        out: where the problem file goes.
        force: write over a file that is there.

    Raises:
        BadInput: the model or a log cannot be read or would be written over, or the file is a link or is there already.
    """
    target = Path(out)
    if target.is_symlink():
        raise BadInput(f"is a link to {target.readlink()}", "give --out the file itself", where=out)
    check_apart([target], {**{Path(log): "a log" for log in logs}, Path(model): "the model"})
    if target.exists() and not force:
        raise BadInput("the file is there already", "choose another --out, or write over it with --force", where=out)
    if not target.parent.is_dir():
        raise BadInput("its folder is not there", "make it, or choose another --out", where=out)
    with Stages() as say:
        drafted = draft(Path(model), [Path(log) for log in logs], target, say)
    write_atomic(target, drafted.text)
    tell(drafted, target)
    return 0


def tell(drafted: Draft, target: Path) -> None:
    """Print what was matched and what was not, and where the file is."""
    for alike in _alike(drafted.matches):
        _say("matched:", *_matched(alike))
    for line in drafted.untied:
        _say("clocks:", line)
    for name, columns in drafted.missing.items():
        _say("missing:", f"{name}: {doubt(columns)}; {cure(name)}")
    for joint, body in drafted.fixed.items():
        _say("missing:", weld_of(joint, body))
    if drafted.idle:
        _say("welded:", held(drafted.idle))
    for question in drafted.questions:
        _say("check:", question)
    if drafted.follows:
        _say("follows:", f"{', '.join(drafted.follows)}, from the others by the model's <equality>")
    if drafted.unused:
        _say("unused:", ", ".join(drafted.unused))
    _say("wrote:", str(target))


def _alike(matches: Sequence[Match]) -> list[list[Match]]:
    """The matches, those of many numbered columns in a row as one."""
    groups = [list(group) for _, group in groupby(matches, key=_kind)]
    return [part for group in groups for part in ([group] if len(group) >= MANY else [[one] for one in group])]


def _kind(found: Match) -> tuple[str, ...]:
    """Matches of one kind differ by a name and a number alone."""
    return found.name.partition(".")[0], NUMBER.sub("#", found.column), found.unit, found.why, found.unit_why


def _matched(alike: Sequence[Match]) -> tuple[str, ...]:
    """Say how one column, or many alike, were matched."""
    found, last = alike[0], alike[-1]
    shown = bool(found.keys) and found.unit_why != Match.unit_why
    by_itself = found.exact or (shown and found.column == found.name)
    said = () if by_itself else (f"({found.why}: check it)",)
    more = (f"({found.unit_why})",) if shown else ()
    names, columns = found.name, found.column
    if last is not found:
        names, columns = f"{names} to {last.name}", f"{columns} to {last.column}"
        said = (f"({len(alike)} columns in the file)", *said)
    return f"{names} <- {columns}{f' [{found.unit}]' if found.unit else ''}", *said, *more


def _say(word: str, *parts: str) -> None:
    """One line; names of a log may hold what a terminal would obey."""
    print(f"{word:<10} {'   '.join(one_line(part) for part in parts)}")
