"""The recording's two text documents, in Markdown."""

from __future__ import annotations

from onlinebayes.criticism import Candidate, Criticism
from onlinebayes.identification import quantities
from onlinebayes.report import candidate_words, phrases, region_words, words

SHOWN = 15


def report(result: Criticism) -> str:
    """Headline, errors, remainder, parameters."""
    lines = [f"# {words.headline(result)}", "", words.improvement(result), "", words.remainder(result), ""]
    lines += [f"- {region_words.in_words(f.where)}: {quantities.percent(f.share_of_error)} of the error of {f.signal}, "
              f"{quantities.percent(f.share_of_time)} of the time" for f in result.failures[:3]]  # fmt: skip
    lines += ["", "| parameter | value |", "|---|---|"]
    lines += [f"| {name} | {phrases.estimate(value)} |" for name, value in result.parameters.items()]
    lines += ["", "Grey: measured. Orange: the model before. Blue: the model after. report.html tells the rest."]
    return "\n".join(lines)


def ranking(result: Criticism) -> str:
    """The candidates with their evidence."""
    if not result.candidates:
        return "No effect was tried: `onlinebayes diagnose` does."
    lines = [
        f"# {result.candidates_tried} candidate effects",
        "",
        "| | effect | evidence | outcome |",
        "|---|---|---|---|",
    ]
    for candidate in candidate_words.in_order(result)[:SHOWN]:
        gain = (
            f"{quantities.significant(candidate.score_gain)} ± {quantities.significant(candidate.score_gain_se or 0.0)}"
            if candidate.score_gain is not None
            else "–"
        )
        lines.append(f"| {candidate.rank or ''} | {phrases.plain(candidate.effect)} | {gain} | {_short(candidate)} |")
    lines += ["", *(f"{sentence}\n" for sentence in candidate_words.ties(result))]
    return "\n".join(lines)


def _short(candidate: Candidate) -> str:
    """The outcome in a column's width."""
    if candidate.accepted:
        return "accepted"
    if candidate.indistinguishable_from:
        return "a tie, see below"
    if candidate.confounded_with:
        first, *more = candidate.confounded_with
        return f"the same as {first}{' and others' if more else ''}"
    refused = candidate.refused_because if candidate.score_gain is not None else ()
    return refused[0] if refused else candidate_words.outcome(candidate)
