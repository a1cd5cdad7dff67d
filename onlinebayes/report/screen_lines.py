"""The first lines of a result, one for each question: how wrong, where, what is missing, how much better, what next.

    share of an addition = (sum of squares before it - after it) / sum of squares of the base model,    in noise floors,

left out inside the fit runs: "explains 53 %". The three largest are named, the others are one line together.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from onlinebayes.criticism import Candidate, Criticism, Step
from onlinebayes.identification import address_of, quantities
from onlinebayes.report import phrases, region_words, words
from onlinebayes.report.candidate_words import tie_members

NAMED = 3
"""Additions that are named each."""

OPEN = 2
"""Directions that the data leave flat, each in a line of its own."""

NEXT = {
    "missing_effect": "use refined.toml; onlinebayes next proposes a log that tests it",
    "tie": "onlinebayes next proposes the recording that tells them apart",
    "adequate": "nothing: the model is as good as these sensors can tell",
    "unexplained": "the report shows the windows in which the error lies",
}

Line = tuple[str, str]
"""A label, and what stands beside it."""


def first_screen(result: Criticism) -> Iterator[Line]:
    """Label and text of each line."""
    if not result.only_compared:  # the headline says that already
        yield "wrong", _wrong(result)
    yield from (("missing" if k == 0 else "", text) for k, text in enumerate(_missing(result)))
    yield from (("units" if k == 0 else "", text) for k, text in enumerate(_units(result)))
    if result.changed:
        yield "better", _better(result)
    if result.verdict != "insufficient_data":
        yield "left", _left(result)
    yield from (("open", text) for text in _open(result))
    if what := _next(result):
        yield "next", what


def shares(result: Criticism) -> dict[str, float]:
    """Return the share of the squared error that each addition takes away, the largest first."""
    if not result.steps:
        return {}
    base = _squares(result, result.steps[0].error_before)
    found = {step.added: _fall(result, step) / base for step in result.steps if step.added in result.accepted}
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _fall(result: Criticism, step: Step) -> float:
    return max(0.0, _squares(result, step.error_before) - _squares(result, step.error_after))


def _squares(result: Criticism, error: Mapping[str, float]) -> float:
    return sum((value / result.sensor_sd[signal]) ** 2 for signal, value in error.items())


def _wrong(result: Criticism) -> str:
    signal, errors = words.worst_signal(result), result.heldout_error
    size = quantities.text(errors.before[signal], result.units[signal])
    ratio = words.over_floor(result, signal)
    over = f"{signal} by {size} over {quantities.exact(errors.horizon_s[signal], 's')}"
    # What is left lies where the error lay: it is said once.
    said = result.remainder.status != "noise" or not result.failures
    where = "" if said else f", most {region_words.in_words(result.failures[0].where)}"
    return f"{over}, {phrases.times_floor(ratio)}{where}"


def _missing(result: Criticism) -> Iterator[str]:
    rows = {candidate.effect: candidate for candidate in result.candidates}
    known = shares(result)
    ordered = [*known, *(key for key in result.accepted if key not in known)]
    yield from (_addition(rows.get(key), key, known.get(key)) for key in ordered[:NAMED])
    if left := ordered[NAMED:]:
        if any(key not in known for key in left):
            yield f"and {phrases.more(len(left), 'effect')}"
        else:
            together = quantities.percent(sum(known[key] for key in left))
            yield f"and {len(left)} smaller imperfections: explain {together}"


def _addition(row: Candidate | None, key: str, share: float | None) -> str:
    sizes = [] if row is None else list(row.parameters.items())
    # One size a run or unit stands in the report: a single one would mislead here.
    size = sizes[0][1] if sizes and address_of(sizes[0][0]) == sizes[0][0] else None
    named = f"{key} {phrases.estimate(size)}" if size is not None else key
    told = [] if row is None or row.probability is None else [f"probability {phrases.probability(row.probability)}"]
    if share is not None:
        told.append(f"explains {quantities.percent(share)}")
    if row is not None and row.score_gain is not None:
        error = quantities.significant(row.score_gain_se or 0.0)
        told.append(f"gain {quantities.significant(row.score_gain)} ± {error}")
    return f"{named}: {', '.join(told)}" if told else named


def _units(result: Criticism) -> Iterator[str]:
    """Describe the parameters that have one value in every unit."""
    shown = list(result.fleet.items())
    yield from (phrases.fleet(address, fleet) for address, fleet in shown[:NAMED])
    if left := shown[NAMED:]:
        yield f"and {phrases.more(len(left), 'parameter')} with a value in every unit, in the report"


def _better(result: Criticism) -> str:
    signal, errors = words.worst_signal(result), result.heldout_error
    before, after, floor = (one[signal] for one in (errors.before, errors.after, errors.noise_floor))
    was, now, noise = quantities.texts((before, after, floor), result.units[signal])
    of_noise = f"; noise {noise}" if floor > 0 else ""
    return f"{was} → {now} on held-out runs, {phrases.better(before, after)}{of_noise}"


def _left(result: Criticism) -> str:
    ratio = quantities.times(max(result.remainder.rms_over_floor.values(), default=math.nan))
    if result.remainder.status == "noise":
        return f"noise ({ratio} that of the sensors)"
    where = f", most {region_words.in_words(result.remainder.where)}" if result.remainder.where else ""
    return f"{ratio} the noise{where}"


def _open(result: Criticism) -> Iterator[str]:
    """Describe the directions of the parameters that the data leave open."""
    flat = result.flat_directions
    yield from (direction.description for direction in flat[:OPEN])
    if left := flat[OPEN:]:
        yield f"and {len(left)} more of the kind, in the report"


def _next(result: Criticism) -> str:
    if result.what_to_record:
        return result.what_to_record
    if result.command == "compare":
        return "onlinebayes diagnose asks which effect is missing" if result.only_compared else ""
    if result.command == "diagnose" and result.accepted:
        return "onlinebayes refine adds it and asks what else is missing"
    if result.verdict == "tie":
        return f"{NEXT['tie']} ({phrases.effects_in_words(tie_members(result), 'or')})"
    if result.verdict == "adequate" and result.flat_directions:
        return "take one of what is open out of [parameters]: weigh it, or trust its data sheet"
    return NEXT.get(result.verdict, "")
