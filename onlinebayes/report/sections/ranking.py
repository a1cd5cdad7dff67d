"""The effects that were tried, the strength of the evidence, and why an effect is in the model or not."""

from __future__ import annotations

from typing import Literal

from onlinebayes.criticism import Candidate, Criticism
from onlinebayes.identification import quantities
from onlinebayes.report import candidate_words, delay_words, phrases, words
from onlinebayes.report.markup import Html, bar, breakable, folded, join, section, table, tag
from onlinebayes.report.sections.summary import sizes
from onlinebayes.simulators.effects import EFFECTS, Scales

SHOWN = 12


def render(result: Criticism) -> Html:
    """The ranking, the ties in words, the way from the base model to the final one."""
    if result.command == "compare":
        return Html("")
    return join(_steps(result), _table(result), _in_words(result), _delays(result), _limits(result))


def _table(result: Criticism) -> Html:
    ranked = [candidate for candidate in result.candidates if candidate.rank is not None]
    if not result.candidates:
        return Html("")
    largest = max((abs(c.score_gain or 0) + (c.score_gain_se or 0) for c in ranked), default=0.0) or 1.0
    ordered = candidate_words.in_order(result)
    rows = [_row(candidate, largest) for candidate in ordered]
    kinds = ["accepted" if candidate.accepted else "" for candidate in ordered]
    head = ("effect", "rank", "probability", "evidence", "size", "outcome")
    note = (
        "Evidence is the gain in log score on data left out of the fit, with its standard error. Probability is that "
        "of the effect being in the machine, as learnt from machines of which the truth is known; what cannot be told "
        "apart shares it, and the rest up to 1 is that of none of them."
    )
    title = f"Ranking of {len(rows)} candidate effects"
    shown = table("Candidate effects, the strongest first", head, rows[:SHOWN], kinds[:SHOWN])
    rest = table("Candidate effects, the others", head, rows[SHOWN:], kinds[SHOWN:])
    more = folded(phrases.more(len(rows) - SHOWN, "candidate"), rest) if rows[SHOWN:] else ""
    return section(title, shown, more, note=note)


def _in_words(result: Criticism) -> Html:
    """Equals, richer relatives, and what the free parameters do already; what nobody wants to count is folded away."""
    sentences = [tag("p", sentence, kind="equals") for sentence in candidate_words.ties(result)]
    sentences += [tag("p", sentence) for sentence in candidate_words.nested(result)]
    same = [tag("li", sentence) for sentence in candidate_words.confounded(result)]
    if same:
        note = (
            "These act like parameters that are free already, so that these data cannot speak for or against them: "
            "to test one, fix those parameters at values known otherwise."
        )
        count = f"{len(same)} candidate{'s' if len(same) > 1 else ''} that free parameters can imitate"
        sentences.append(folded(count, tag("p", note, kind="note"), tag("ul", *same)))
    if still := candidate_words.motionless(result):
        sentences.append(tag("p", still, kind="note"))
    return section("What cannot be told apart", *sentences) if sentences else Html("")


def _delays(result: Criticism) -> Html:
    """Where a delay that was found is: what this log says of each stage, and which recording would say more."""
    parts = []
    for delay in result.delays:
        title = f"Where it is: {delay_words.found(delay)}"
        parts.append(table(title, ("stage", "effect", "this log"), delay_words.rows(delay)))
        parts += [tag("p", sentence) for sentence in delay_words.recordings(delay)]
    return section("Where the delay is", *parts, note=delay_words.NOTE) if parts else Html("")


def _row(candidate: Candidate, largest: float) -> tuple[str, ...]:
    gain, error = candidate.score_gain, candidate.score_gain_se or 0.0
    evidence = (
        bar(
            gain / largest, "gain", f"{quantities.significant(gain)} ± {quantities.significant(error)}", error / largest
        )
        if gain is not None
        else Html("–")
    )
    return (
        join(phrases.plain(candidate.effect), tag("small", tag("code", breakable(candidate.effect)))),
        str(candidate.rank or "–"),
        "–" if candidate.probability is None else phrases.probability(candidate.probability),
        evidence,
        sizes([candidate], intervals=True) or "–",
        candidate_words.outcome(candidate),
    )


def _steps(result: Criticism) -> Html:
    """The cross-validated error of the worst signal after each acceptance, as bars."""
    if not result.steps:
        return Html("")
    scored = result.steps[0].error_before
    signal = words.worst_signal(result)
    signal = signal if signal in scored else next(iter(scored))
    unit, first = result.units[signal], result.steps[0].error_before[signal]
    scale = quantities.scale_for(first, unit)
    rows: list[tuple[str, ...]] = [("the base model, refitted", bar(1.0, "before", scale.text(first)))]
    for step in result.steps:
        error, what = step.error_after[signal], tag("small", phrases.meaning(step.added))
        rows.append((join(f"+ {phrases.plain(step.added)}", what), bar(error / first, "after", scale.text(error))))
    note = f"Error of {signal} on data left out of each fit; the held-out runs had no part in it."
    return section(
        "Step by step", table("Error after each addition", ("model", "cross-validated error"), rows), note=note
    )


def _limits(result: Criticism) -> Html:
    limited = [c for c in result.candidates if c.exclusion_limit is not None and not c.accepted]
    if not limited:
        return Html("")
    rows = []
    for candidate in limited:
        name, unit = _first_parameter(result, candidate)
        size = quantities.text(candidate.exclusion_limit, unit)
        rows.append((phrases.plain(candidate.effect), f"{name} above {size}".strip()))
    note = "Had one of these effects been larger than this, these data would have shown it"
    note += "; beside what was accepted, the limit is for what comes on top of it." if result.accepted else "."
    head, title = ("effect", "excluded"), "What is excluded"
    rest = table("More limits", head, rows[SHOWN:])
    more = folded(phrases.more(len(rows) - SHOWN, "limit"), rest) if rows[SHOWN:] else ""
    return section(title, table("Limits at 95 %", head, rows[:SHOWN]), more, note=note)


def _first_parameter(result: Criticism, candidate: Candidate) -> tuple[str, str]:
    """Name and unit of the parameter that an exclusion limit is about; empty where the vocabulary lacks the effect."""
    for name, estimate in candidate.parameters.items():
        return name, estimate.unit
    kind, _, target = candidate.effect.partition("@")
    if kind not in EFFECTS:
        return "", ""
    slide = result.units.get(f"qpos.{target}") == "m" or result.units.get(f"qvel.{target}") == "m/s"
    joint: Literal["slide", "hinge"] = "slide" if slide else "hinge"
    effect = EFFECTS[kind].scaled(target, Scales(1.0, 1.0, 1.0, 1.0, joint))
    return next(((name, parameter.unit) for name, parameter in effect.parameters.items()), ("", ""))
