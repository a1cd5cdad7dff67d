"""Summary of a command's result, for a terminal of 80 columns, in about ten lines; the report has the rest."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

from onlinebayes.criticism import Criticism
from onlinebayes.report import first_screen, left_out, lost, words

WIDTH = 80


def summary(result: Criticism, folder: Path, more: Sequence[str] = ()) -> str:
    """Verdict, how wrong, what is missing, how much better, what next, and where the report lies.

    Args:
        result: what the command returned.
        folder: where its report was written.
        more: names of further files there.
    """
    by_hand = result.final.effects
    tried = f"with {', '.join(by_hand)} added by hand" if by_hand else "no effect was tried"
    asked = f" ({tried})" if result.only_compared else ""
    lines = labelled("verdict", f"{result.verdict}{asked}")
    lines += _wrapped(words.headline(result), " " * 11, " " * 11)
    for label, text in first_screen(result):
        lines += labelled(label, text)
    lines += _to_write(result)
    lines += _noted(result.notes)
    if more:
        lines += _wrapped(words.put_right(result))
        lines += _wrapped(words.left_out(left_out(result), more, lost(result)), others=" " * 11)
        lines += _wrapped(words.file_error(result, more), others=" " * 11)
    files = ", ".join((str(folder / "report.html"), *more))
    return "\n".join([*lines, *labelled("report", f"{files}; to open: onlinebayes show {folder}")])


def _to_write(result: Criticism) -> Iterator[str]:
    """Show the lines that have to be written into the problem file, with the reason."""
    if result.wiring:
        yield from labelled("wiring", words.wiring(result))
        yield from _block(result.wiring.lines)
    for sentence in words.bounds(result):
        yield from labelled("bounds", sentence)
    for sentence, change in zip(words.changes(result), result.changes, strict=True):
        yield from labelled("change", sentence)
        yield from _block(change.lines)


def _block(lines: str) -> Iterator[str]:
    yield "to put in the problem file:"
    yield from (f"    {line}" for line in lines.splitlines())


def _noted(notes: Sequence[str]) -> list[str]:
    """The first note; how many more the report has."""
    if not notes:
        return []
    rest = len(notes) - 1
    others = f" ({rest} more note{'s' if rest > 1 else ''} in the report)" if rest else ""
    return labelled("note", f"{notes[0]}{others}")


def labelled(label: str, text: str) -> list[str]:
    """``label:`` in a column of its own, the text beside it wrapped."""
    return _wrapped(text, f"{label and label + ':':<11}", " " * 11)


def _wrapped(text: str, first: str = "", others: str = "") -> list[str]:
    """Lines in which a number stays with its unit."""
    kept = re.sub(r"(?<=\d) (?=[a-zA-Zµ%])", "\u00a0", text)
    lines = textwrap.wrap(
        kept, WIDTH, initial_indent=first, subsequent_indent=others, break_long_words=False, break_on_hyphens=False
    )
    return [line.replace("\u00a0", " ") for line in lines]
