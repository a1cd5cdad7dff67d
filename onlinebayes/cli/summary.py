"""What a command found, for a terminal of 80 columns; the sentences are the report's."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from pathlib import Path

from onlinebayes.criticism import Candidate, Criticism
from onlinebayes.criticism.report import candidate_words, left_out, words
from onlinebayes.identification import quantities

WIDTH = 80
RANKS = 5
"""How many of the ranked effects are shown."""
SIGNALS = 6
"""How many of the signals are shown, the worst first."""


def summary(result: Criticism, folder: Path, more: Sequence[str] = ()) -> str:
    """Verdict, held-out error, candidates, what is left, and where the report lies.

    Args:
        result: what the command returned.
        folder: where its report was written.
        more: names of further files there.
    """
    by_hand = result.final.effects
    tried = f"with {', '.join(by_hand)} added by hand" if by_hand else "no effect was tried"
    asked = f" ({tried})" if result.only_compared else ""
    lines = _labelled("verdict", f"{result.verdict}{asked}")
    sentences = [words.headline(result), words.improvement(result)]
    if result.verdict != "insufficient_data":
        sentences.append(words.remainder(result))
    for sentence in sentences:
        lines += _wrapped(sentence)
    if result.wiring:
        lines += _labelled("wiring", words.wiring(result))
        lines += ["to put in the problem file:", *(f"    {line}" for line in result.wiring.lines.splitlines())]
    if result.what_to_record:
        lines += _labelled("to record", result.what_to_record)
    lines += ["", *_errors(result), ""]
    if any(candidate.rank is not None for candidate in result.candidates):
        lines += [*_candidates(result), ""]
    if result.accepted:
        lines += _labelled("added", ", ".join(result.accepted))
    for sentence in words.bounds(result):
        lines += _labelled("bounds", sentence)
    for sentence, change in zip(words.changes(result), result.changes, strict=True):
        lines += _labelled("change", sentence)
        lines += ["to put in the problem file:", *(f"    {line}" for line in change.lines.splitlines())]
    for note in result.notes:
        lines += _labelled("note", note)
    lines += [f"wrote:     {folder / name}" for name in more]
    if more:
        lines += _wrapped(words.put_right(result))
        lines += _wrapped(words.left_out(left_out(result), more), others=" " * 11)
    lines += [f"report:    {folder / 'report.html'}", f"to open:   onlinebayes show {folder}"]
    return "\n".join(lines)


def _errors(result: Criticism) -> list[str]:
    """Error before, after and floor of the signals, the worst first."""
    errors, order = result.heldout_error, words.signals_by_error(result)
    lines = [f"{'held-out error (RMS)':<38} {'before':>12} {'after':>12} {'floor':>12}"]
    for signal in order[:SIGNALS]:
        before, after, floor = errors.before[signal], errors.after[signal], errors.noise_floor[signal]
        was, now, noise = quantities.texts((before, after, floor), result.units[signal])
        cells = (was, now if result.changed else "–", noise)
        lines.append(f"  {_cut(signal, 36):<36} " + " ".join(f"{_cut(cell, 12):>12}" for cell in cells))
    return [*lines, *_others(len(order) - SIGNALS, "signal", ", with smaller errors")]


def _candidates(result: Criticism) -> list[str]:
    """Gain of the ranked effects, the first ones and all that are in the model, with their rivals."""
    ranked = [candidate for candidate in candidate_words.in_order(result) if candidate.rank is not None]
    shown = [c for k, c in enumerate(ranked) if k < RANKS or c.accepted or c.indistinguishable_from]
    lines = [f"{'candidate effects':<35} {'gain':>11}  outcome"]
    lines += [_candidate(result, candidate) for candidate in shown]
    return [*lines, *_others(len(result.candidates) - len(shown), "candidate", " in the report")]


def _candidate(result: Criticism, candidate: Candidate) -> str:
    gain = "–"
    if candidate.score_gain is not None:
        error = quantities.significant(candidate.score_gain_se or 0.0)
        gain = f"{quantities.significant(candidate.score_gain)} ± {error}"
    start = f"{candidate.rank:>4} {_cut(candidate.effect, 30):<30} {gain:>11}  "
    return start + _cut(candidate_words.briefly(result, candidate), WIDTH - len(start))


def _others(count: int, what: str, where: str) -> list[str]:
    return [f"  and {count} more {what}{'s' if count > 1 else ''}{where}"] if count > 0 else []


def _labelled(label: str, text: str) -> list[str]:
    """``label:`` in a column of its own, the text beside it wrapped."""
    return _wrapped(text, f"{label + ':':<11}", " " * 11)


def _wrapped(text: str, first: str = "", others: str = "") -> list[str]:
    """Lines in which a number stays with its unit."""
    kept = re.sub(r"(?<=\d) (?=[a-zA-Zµ%])", "\u00a0", text)
    lines = textwrap.wrap(kept, WIDTH, initial_indent=first, subsequent_indent=others, break_long_words=False)
    return [line.replace("\u00a0", " ") for line in lines]


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: max(width - 1, 0)]}…"
