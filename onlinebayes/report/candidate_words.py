"""The candidates in words: in which order they are shown, why each is in the model or not, and what equals what."""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.criticism import MOVES_NOTHING, Candidate, Criticism
from onlinebayes.report.phrases import capitalised, effects_in_words, listing, plain


def in_order(result: Criticism) -> list[Candidate]:
    """The candidates as tables show them: by rank, the rivals of an accepted effect right after it.

    What a rival would add beside that effect says nothing of the rival: those numbers are left out.
    """
    rows = {candidate.effect: candidate for candidate in result.candidates}
    ordered: dict[str, Candidate] = {}
    for candidate in result.candidates:
        ordered.setdefault(candidate.effect, candidate)
        for rival in candidate.indistinguishable_from if candidate.accepted else ():
            if rival in rows and not rows[rival].accepted:
                ordered[rival] = replace(rows[rival], score_gain=None, score_gain_se=None, parameters={})
    return list(ordered.values())


def outcome(candidate: Candidate) -> str:
    """Why a candidate is in the model or not, in a few words."""
    if candidate.accepted:
        return "accepted"
    if MOVES_NOTHING in candidate.confounded_with:
        return "moves nothing that was measured"
    if candidate.confounded_with:
        same = listing(list(candidate.confounded_with))
        return f"the same as {same}{', free already' if len(candidate.confounded_with) == 1 else ' together'}"
    if candidate.indistinguishable_from:
        equal = listing([plain(effect) for effect in candidate.indistinguishable_from], "or")
        return f"explains as much as {equal}"
    if candidate.score_gain is None:
        reason = candidate.refused_because[0] if candidate.refused_because else "not tried further"
        return reason.partition(" (")[0].partition(":")[0]
    return "; ".join(candidate.refused_because)


def tie_members(result: Criticism) -> tuple[str, ...]:
    """The first accepted effect and those that it cannot be told from; in order of rank without an accepted one."""
    first = result.accepted[0] if result.accepted else None
    for candidate in result.candidates:
        if candidate.indistinguishable_from and candidate.effect == (first or candidate.effect):
            return (candidate.effect, *candidate.indistinguishable_from)
    return result.accepted


def ties(result: Criticism) -> list[str]:
    """One sentence for each effect that has an equal among the others."""
    sentences, named = [], set()
    for candidate in result.candidates:
        group = frozenset((candidate.effect, *candidate.indistinguishable_from))
        if len(group) < 2 or group in named:
            continue
        named.add(group)
        others = listing([plain(effect) for effect in candidate.indistinguishable_from], "or")
        sentences.append(
            f"{capitalised(plain(candidate.effect))} explains these data no better and no worse than {others}. "
            "Nothing measured here decides between them; what you know of the machine, or an experiment in which they "
            "act differently, does."
        )
    return sentences


def nested(result: Criticism) -> list[str]:
    """One sentence for each candidate that a richer one contains."""
    return [
        f"{capitalised(plain(candidate.effect))} is a special case of "
        f"{listing([plain(effect) for effect in candidate.nested_in], 'and of')}: the richer effect enters only where "
        "the simpler one does not do."
        for candidate in result.candidates
        if candidate.nested_in and candidate.score_gain is not None
    ]


def confounded(result: Criticism) -> list[str]:
    """One phrase for each candidate that the free parameters do already: ``viscous friction at a: a.damping``."""
    return [
        f"{plain(candidate.effect)}: {listing(list(candidate.confounded_with))}"
        for candidate in result.candidates
        if candidate.confounded_with and MOVES_NOTHING not in candidate.confounded_with
    ]


def motionless(result: Criticism) -> str:
    """One sentence on the candidates that move no measured signal; empty without any."""
    still = [candidate.effect for candidate in result.candidates if MOVES_NOTHING in candidate.confounded_with]
    return f"{capitalised(effects_in_words(still))} would move nothing that was measured." if still else ""
