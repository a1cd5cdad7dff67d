"""What a command found, in a few lines for the terminal; the sentences are the report's."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from onlinebayes.criticism import Criticism
from onlinebayes.criticism.report import words

RANKS = 3
"""How many of the ranked effects are shown."""


def summary(result: Criticism, folder: Path, more: Sequence[str] = ()) -> str:
    """Verdict, effects, held-out error before and after, what is left, and where the report lies.

    Args:
        result: what the command returned.
        folder: where its report was written.
        more: names of further files there.
    """
    lines = [] if result.verdict is None else [f"verdict:   {result.verdict}"]
    lines += [words.headline(result), words.improvement(result)]
    if result.verdict != "insufficient_data":
        lines.append(words.remainder(result))
    if result.what_to_record:
        lines.append(f"to record: {result.what_to_record}")
    if result.command == "diagnose":
        lines += _ranking(result)
    if result.accepted:
        lines.append(f"added:     {', '.join(result.accepted)}")
    lines += [f"bounds:    {sentence}" for sentence in words.bounds(result)]
    lines += [f"note:      {note}" for note in result.notes]
    lines += [f"wrote:     {folder / name}" for name in more]
    lines.append(f"report:    {folder / 'report.html'}   (to open it: onlinebayes show {folder})")
    return "\n".join(lines)


def _ranking(result: Criticism) -> list[str]:
    ranked = [candidate for candidate in result.candidates if candidate.rank is not None]
    ranked.sort(key=lambda candidate: candidate.rank or 0)
    lines = []
    for candidate in ranked[:RANKS]:
        p = "" if candidate.p_value is None else f", p = {candidate.p_value:.2g}"
        size = f"  {words.size(result, candidate)}" if candidate.parameters else ""
        lines.append(f"{candidate.rank:>4}. {candidate.effect}{size}{p}: {words.outcome(candidate)}")
    return lines
