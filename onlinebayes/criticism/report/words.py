"""The report's sentences: what a result means, in the words of whoever owns the robot.

Everything here is text made from a :class:`~onlinebayes.criticism.results.Criticism`; HTML, recording and terminal say
the same. The signal that a sentence speaks of is the one whose base error stands highest above its noise.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

from onlinebayes.criticism import places, quantities
from onlinebayes.criticism.report.mending import keys_of
from onlinebayes.criticism.results import MOVES_NOTHING, STOPPED, Candidate, Criticism, Estimate, ParameterChange
from onlinebayes.criticism.scope import address_of
from onlinebayes.simulators.effects import EFFECTS

VERDICTS = {
    "data_problem": "problem in the data",
    "insufficient_data": "too little data",
    "bounds_exclude_truth": "a bound excludes the truth",
    "tie": "tie",
    "missing_effect": "missing effect",
    "unexplained": "unexplained",
    "adequate": "adequate",
}
SHOWN_RUNS = 8
"""How many runs' own values stand in a sentence."""


def plain(effect: str) -> str:
    """``dry_friction@carriage`` -> ``dry friction at carriage``."""
    name, _, target = effect.partition("@")
    return f"{name.replace('_', ' ')} at {target}" if target else name.replace("_", " ")


def together(effects: Sequence[str], last: str = "and") -> str:
    """``dry friction and constant load at carriage, actuator delay at left and right``, grouped by target."""
    by_target: dict[str, list[str]] = {}
    for effect in effects:
        name, _, target = effect.partition("@")
        by_target.setdefault(target, []).append(name.replace("_", " "))
    by_names: dict[tuple[str, ...], list[str]] = {}
    for target, names in by_target.items():
        by_names.setdefault(tuple(names), []).append(target)
    groups = [
        f"{listing(names, last)}{f' at {listing(sorted(targets), last)}' if any(targets) else ''}"
        for names, targets in by_names.items()
    ]
    return f", {last} ".join(groups)


def meaning(effect: str) -> str:
    """What an effect of the vocabulary is, in one phrase from its own documentation; empty for others."""
    kind = EFFECTS.get(effect.partition("@")[0])
    first = (kind.__doc__ or "").strip().splitlines()[0] if kind else ""
    return re.split(r"[;.](?:\s|$)", first)[0]


def listing(items: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""


def worst_signal(result: Criticism) -> str:
    """The signal whose base error is largest in units of its noise floor."""
    return signals_by_error(result)[0]


def signals_by_error(result: Criticism) -> list[str]:
    """The scored signals, the one that stands highest above its noise floor first."""
    scored = [signal for signal in result.signals if signal in result.heldout_error.before]
    return sorted(scored, key=lambda signal: -over_floor(result, signal))


def over_floor(result: Criticism, signal: str) -> float:
    """The base model's held-out error over its noise floor."""
    floor = result.heldout_error.noise_floor[signal]
    return result.heldout_error.before[signal] / floor if floor > 0 else math.inf


def headline(result: Criticism) -> str:
    """One sentence: what is wrong, or that nothing is."""
    effects = together(result.accepted)
    if result.only_compared or (result.command == "compare" and result.verdict == "insufficient_data"):
        return _compared(result)
    if result.verdict == "missing_effect":
        besides = f"; besides, {_differs(result)}" if result.changes else ""
        return f"The model misses {effects}{besides}{_not_all(result)}."
    if result.verdict == "tie":
        return f"Something is missing, and the data cannot tell which: {together(tie_members(result), 'or')}."
    if result.verdict == "adequate":
        return "Nothing is missing: the model agrees with the measurements."
    if result.verdict == "insufficient_data":
        return "There is too little data to tell whether anything is missing."
    if result.verdict == "bounds_exclude_truth":
        return f"No effect is missing: the bounds of {listing(list(result.widened))} exclude what the data ask for."
    if result.verdict == "data_problem":
        fault = f" ({result.wiring.fault})" if result.wiring else ""
        return f"The data themselves explain the misfit better than any missing physics{fault}."
    if result.verdict == "unexplained" and result.changes:
        helped = f"; {effects} helps, but not enough" if result.accepted else ""
        return f"No effect explains the misfit, a change does: {_differs(result)}{helped}."
    helped = f"; {effects} helps, but not enough" if result.accepted else ""
    if result.interrupted:
        leading = [candidate.effect for candidate in result.candidates if STOPPED in candidate.refused_because][:1]
        so_far = f"; so far {together(leading)} leads" if leading else ""
        return f"The model is wrong, and the search was stopped before it could say why{helped}{so_far}."
    return f"The model is wrong, and no effect that was tried explains it{helped}."


def _not_all(result: Criticism) -> str:
    """That a law close to the one that is named may be meant, or another besides; empty where only noise is left."""
    if result.remainder.status == "noise":
        return ""
    it = "it" if len(result.accepted) == 1 else "them"
    return f", or what acts much like {it}: most of the misfit is explained, not all"


def improvement(result: Criticism) -> str:
    """One sentence with the held-out error before and after, and the floor."""
    signal = worst_signal(result)
    errors, unit = result.heldout_error, result.units[signal]
    before, after, floor = errors.before[signal], errors.after[signal], errors.noise_floor[signal]
    compared = (before, after, floor) if result.changed else (before, floor)
    was, *now, noise = quantities.texts(compared, unit)
    over = f"Held-out error over {quantities.exact(errors.horizon_s[signal], 's')}"
    change = f" → {now[0]} ({better(before, after)})" if now else ""
    return f"{over}: {was}{change}; noise explains {noise}{_starts(result, signal)}."


def wiring(result: Criticism) -> str:
    """What the wiring check found and how far mending it brings the error, in one sentence; empty with nothing."""
    found = result.wiring
    if found is None:
        return ""
    others = (
        f" Just as well: {listing([fault for fault, _ in found.alternatives], 'or')}." if found.alternatives else ""
    )
    fall = f"{quantities.times(found.error_before)} to {quantities.times(found.error_after)} the sensor noise"
    return f"{found.fault}; putting that right takes the cross-validated error from {fall}.{others}"


def put_right(result: Criticism) -> str:
    """What refined.toml and refined.xml hold where the data have a fault, in one sentence; empty without one."""
    if result.verdict != "data_problem" or result.wiring is None:
        return ""
    if result.mended is None:
        return (
            "refined.toml and refined.xml hold the model fitted to the table with the fault: put it right and run "
            "again before you use them."
        )
    values = "its values and refined.xml are fitted to the mended table."
    if keys_of(result.wiring):
        return f"refined.toml has the fault put right; {values}"
    return f"refined.toml reads the table with the fault, which can only be put right there; {values}"


def left_out(effects: Sequence[str], files: Sequence[str]) -> str:
    """What refined.xml cannot hold, in one line; empty without any.

    Args:
        effects: their keys.
        files: names of the refined files.
    """
    if not effects or "refined.xml" not in files:
        return ""
    there = f"; refined.toml has {'it' if len(effects) == 1 else 'them'}" if "refined.toml" in files else ""
    return f"refined.xml: without {listing(list(effects))}, which plain MuJoCo has no term for{there}"


def bounds(result: Criticism) -> list[str]:
    """One sentence for each bound that excludes the truth: the value that the data ask for, and what to write."""
    sentences = []
    for name, widened in result.widened.items():
        low, high = (quantities.exact(value, result.parameters[name].unit) for value in widened.before)
        wide = ", ".join(f"{value:g}" for value in widened.after)
        sentences.append(
            f"The data ask for {estimate(result.parameters[name])}; the bounds were {low} to {high}. If that can be, "
            f'write "{address_of(name)}" = [{wide}] under [parameters]; if it cannot, look for what acts like it. The '
            "held-out error after is that of the model with this bound widened."
        )
    return sentences


def changes(result: Criticism) -> list[str]:
    """One sentence for each parameter that differs between runs: its values, and what one in every run brought."""
    sentences = []
    for change in result.changes:
        shown = [f"{run} {estimate(value)}" for run, value in list(change.values.items())[:SHOWN_RUNS]]
        left = len(change.values) - SHOWN_RUNS
        shown += [f"{left} more in the report"] if left > 0 else []
        unit = next(iter(change.values.values())).unit
        if change.groups:
            told = "; ".join(f"{_few(group)} at {_level(change, group)}" for group in change.groups)
            shown = [f"{told} ({len(change.groups)} groups of like values)"]
        others = f" Values of {listing(list(change.equals), 'or')} would do as well." if change.equals else ""
        sentences.append(
            f"{change.parameter} differs between runs: {listing(shown)}, where one value for all was "
            f"{quantities.text(change.shared, unit)}; with a value in every run the cross-validated error falls by "
            f"{quantities.percent(change.rms_fall[0])}.{others}"
        )
    return sentences


def _few(runs: Sequence[str]) -> str:
    """``n00, n01 and 6 more``."""
    left = len(runs) - SHOWN_RUNS // 2
    return listing([*runs[: SHOWN_RUNS // 2], f"{left} more"] if left > 1 else list(runs))


def _level(change: ParameterChange, runs: Sequence[str]) -> str:
    """``0.7512 ± 0.0007 kg``: the mean over a group's runs, and their mean sd."""
    values = [change.values[run] for run in runs]
    mean, sd = (sum(numbers) / len(values) for numbers in zip(*((v.mean, v.sd) for v in values), strict=True))
    return quantities.with_error(mean, sd, values[0].unit)


def _starts(result: Criticism, signal: str) -> str:
    """What the error is once the windows' starts are fitted, where those as measured are what errs; else empty."""
    left = result.fitted_starts.get(signal)
    if left is None:
        return ""
    return (
        ", the uncertain starts of the windows the rest: with those fitted, "
        f"{quantities.times(left)} the sensor noise is left"
    )


def better(before: float, after: float) -> str:
    """``3.3 times better``, ``12 % better`` or ``no better``."""
    ratio = before / after if after > 0 else math.inf
    if ratio >= 1.5:
        return f"{quantities.times(ratio)} better"
    return f"{quantities.percent(1 - after / before)} better" if ratio > 1.005 else "no better"


def times_floor(ratio: float) -> str:
    """``33 times the noise floor``, or ``at the noise floor``."""
    if not math.isfinite(ratio):
        return "no noise floor is known"
    return "at the noise floor" if ratio <= 1.05 else f"{quantities.times(ratio)} the noise floor"


def remainder(result: Criticism) -> str:
    """What is left after the accepted effects."""
    ratio = max(result.remainder.rms_over_floor.values(), default=math.nan)
    if result.remainder.status == "noise":
        return f"What is left looks like noise ({quantities.times(ratio)} the sensor noise)."
    where = f"; it concentrates {places.plainly(result.remainder.where)}" if result.remainder.where else ""
    return f"What is left is not noise, {quantities.times(ratio)} the sensor noise{where}."


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
            f"{_capital(plain(candidate.effect))} explains these data no better and no worse than {others}. "
            "Nothing measured here decides between them; what you know of the machine, or an experiment in which they "
            "act differently, does."
        )
    return sentences


def nested(result: Criticism) -> list[str]:
    """One sentence for each candidate that a richer one contains."""
    return [
        f"{_capital(plain(candidate.effect))} is a special case of "
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
    return f"{_capital(together(still))} would move nothing that was measured." if still else ""


def estimate(value: Estimate) -> str:
    """``mean ± sd unit``."""
    return quantities.with_error(value.mean, value.sd, value.unit)


def interval(value: Estimate) -> str:
    """``92.6 to 97.4 kg``, in the unit that suits the mean."""
    largest, width = max(abs(value.q05), abs(value.q95)), value.q95 - value.q05
    scale = quantities.scale_for(largest, value.unit)
    digits = 3 if not 0 < width < largest else max(3, math.ceil(math.log10(largest / width)) + 2)
    return f"{scale.number(value.q05, digits)} to {scale.text(value.q95, digits)}"


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
                ordered[rival] = _beside(rows[rival], result.selection.alpha)
    return list(ordered.values())


def _beside(rival: Candidate, alpha: float) -> Candidate:
    if rival.p_value is not None and rival.p_value <= alpha:  # judged in the accepted effect's own round
        return rival
    return replace(
        rival, p_value=None, score_gain=None, score_gain_se=None, rms_fall=None, homogeneous=None, parameters={}
    )


def briefly(result: Criticism, candidate: Candidate) -> str:
    """The outcome without its numbers: ``brings too little``."""
    if candidate.accepted_with:
        partners = [f"#{row.rank}" for row in result.candidates if row.effect in candidate.accepted_with and row.rank]
        return f"accepted, only with {listing(partners)}" if partners else "accepted, one of a pair"
    if candidate.indistinguishable_from and not candidate.accepted:
        equals = [row for row in result.candidates if row.effect in candidate.indistinguishable_from and row.rank]
        return f"explains as much as {listing([f'#{row.rank}' for row in equals])}" if equals else "explains as much"
    return outcome(candidate).partition(":")[0]


def outcome(candidate: Candidate) -> str:
    """Why a candidate is in the model or not, in a few words."""
    if candidate.accepted_with:
        return f"accepted together with {together(candidate.accepted_with)}"
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


def _differs(result: Criticism) -> str:
    """``body.cart.mass differs between the runs``."""
    named = [change.parameter for change in result.changes]
    return f"{listing(named)} {'differs' if len(named) == 1 else 'differ'} between the runs"


def _compared(result: Criticism) -> str:
    signal = worst_signal(result)
    before, ratio = result.heldout_error.before[signal], over_floor(result, signal)
    size = quantities.text(before, result.units[signal])
    horizon = quantities.exact(result.heldout_error.horizon_s[signal], "s")
    if ratio <= result.selection.tolerance:
        return f"The model follows {signal} to {size} over {horizon}, as well as its noise allows."
    if signal in result.fitted_starts and result.remainder.status == "noise":
        return f"The model follows {signal} to {size} over {horizon}, as well as the windows' measured starts allow."
    return f"The model misses {signal} by {size} over {horizon}, {times_floor(ratio)}."


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
