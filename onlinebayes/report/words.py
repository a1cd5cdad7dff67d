"""The report's sentences: what a result means, in the words of whoever owns the robot.

Everything here is text made from a :class:`~onlinebayes.criticism.results.Criticism`; HTML, recording and terminal say
the same. The signal that a sentence speaks of is the one whose base error stands highest above its noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from onlinebayes.criticism import Criticism
from onlinebayes.identification import LEAST_GAIN, address_of, quantities
from onlinebayes.report import region_words
from onlinebayes.report.candidate_words import tie_members
from onlinebayes.report.correction import keys_of
from onlinebayes.report.phrases import better, effects_in_words, estimate, listing, times_floor

VERDICTS = {
    "data_problem": "problem in the data",
    "insufficient_data": "too little data",
    "bounds_exclude_truth": "a bound excludes the truth",
    "tie": "tie",
    "missing_effect": "missing effect",
    "unexplained": "unexplained",
    "adequate": "adequate",
}


SURE, PROBABLE = 0.9, 0.5
"""Probabilities from which on an effect is said to be missing, and to be probably missing."""

BEYOND = "each ± may be too small"
"""Of a model that leaves more than noise: what it lacks may move its values, and no interval knows how far."""

NOT_ALL = f"; not all is explained, {BEYOND}"

SHOWN_RUNS = 8
"""The most runs whose own values stand in a sentence."""


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
    effects = effects_in_words(result.accepted)
    if result.only_compared or (result.command == "compare" and result.verdict == "insufficient_data"):
        return _compared(result)
    if result.verdict == "missing_effect":
        besides = f"; besides, {_differs(result)}" if result.changes else ""
        return f"The model {_misses(result)} {effects}{besides}{_not_all(result)}."
    if result.verdict == "tie":
        return f"Something is missing, and the data cannot tell which: {effects_in_words(tie_members(result), 'or')}."
    if result.verdict == "adequate":
        return "Nothing is missing: the model agrees with the measurements."
    if result.verdict == "insufficient_data":
        return "There is too little data to tell whether anything is missing."
    if result.verdict == "bounds_exclude_truth":
        found = f"the bounds of {listing(list(result.widened))} exclude what the data ask for"
        if result.remainder.status == "noise":
            return f"No effect is missing: {found}."
        return f"{found[0].upper()}{found[1:]}, or something that acts like them is missing{NOT_ALL}."
    if result.verdict == "data_problem":
        fault = f" ({result.wiring.fault})" if result.wiring else ""
        return f"The data themselves explain the misfit better than any missing physics{fault}."
    helped = f"; {effects} {_does(result)}" if result.accepted else ""
    if result.contradicted and not result.accepted:
        fits = "fits the runs it was" if len(result.contradicted) == 1 else "fit the runs they were"
        helped = f"; {effects_in_words(result.contradicted)} {fits} fitted to, and not the held-out ones"
    if result.verdict == "unexplained" and result.changes:
        return f"No effect explains the misfit, a change does: {_differs(result)}{helped}."
    if result.interrupted:
        return f"The model is wrong, and the search was stopped before it could say why{helped}."
    if not result.candidates:
        return f"The model is wrong, and the search ended before any effect was tried{helped}."
    return f"The model is wrong, and no effect that was tried explains it{helped}."


def _misses(result: Criticism) -> str:
    """How surely: ``misses``, ``probably misses`` or ``may miss``, by the least probable of what was accepted.

    What stood in the model where the search was stopped, and was not judged by itself, may be missing.
    """
    accepted = [c for c in result.candidates if c.accepted]
    if any(c.score_gain is None for c in accepted):
        return "may miss"
    least = min((c.probability for c in accepted if c.probability is not None), default=1.0)
    return "misses" if least >= SURE else "probably misses" if least >= PROBABLE else "may miss"


def _does(result: Criticism) -> str:
    """Describe the effects that were added and explain too little."""
    one = len(result.accepted) == 1
    if result.held_out_gain < LEAST_GAIN:
        return f"{'fits the runs it was' if one else 'fit the runs they were'} fitted to, and not the held-out ones"
    return f"{'helps' if one else 'help'}, but not enough"


def _not_all(result: Criticism) -> str:
    """Add that a similar law may be meant, or another besides the one that is named; empty where only noise is left."""
    if result.remainder.status == "noise":
        return ""
    it = "it" if len(result.accepted) == 1 else "them"
    return f", or what acts much like {it}{NOT_ALL}"


def improvement(result: Criticism) -> str:
    """One sentence with the held-out error before and after, and the floor."""
    signal = worst_signal(result)
    errors, unit = result.heldout_error, result.units[signal]
    before, after, floor = errors.before[signal], errors.after[signal], errors.noise_floor[signal]
    compared = (before, after, floor) if result.changed else (before, floor)
    was, *now, noise = quantities.texts(compared, unit)
    over = f"Held-out error over {quantities.exact(errors.horizon_s[signal], 's')}"
    change = f" → {now[0]} ({better(before, after)})" if now else ""
    explained = f"noise explains {noise}" if floor > 0 else "how much of it noise explains is not known"
    return f"{over}: {was}{change}; {explained}."


def wiring(result: Criticism) -> str:
    """State the wiring fault that was found and the error with it mended, in one sentence; empty with nothing."""
    found = result.wiring
    if found is None:
        return ""
    others = (
        f" Just as well: {listing([fault for fault, _ in found.alternatives], 'or')}." if found.alternatives else ""
    )
    fall = f"{quantities.times(found.error_before)} to {quantities.times(found.error_after)} the sensor noise"
    return f"{found.fault}; putting that right takes the cross-validated error from {fall}.{others}"


def put_right(result: Criticism) -> str:
    """Describe refined.toml and refined.xml where the data have a fault, in one sentence; empty without one."""
    if result.verdict != "data_problem" or result.wiring is None:
        return ""
    if result.corrected is None:
        return (
            "refined.toml and refined.xml hold the model fitted to the table with the fault: put it right and run "
            "again before you use them."
        )
    values = "its values and refined.xml are fitted to the mended table."
    if keys_of(result.wiring.lines):
        return f"refined.toml has the fault put right; {values}"
    return f"refined.toml reads the table with the fault, which can only be put right there; {values}"


def left_out(effects: Mapping[str, str], files: Sequence[str], lost: Mapping[str, str]) -> str:
    """List the effects that refined.xml cannot hold, in one line; empty without any.

    Args:
        effects: their keys -> why, as a clause.
        files: names of the refined files.
        lost: those that refined_model.py cannot hold either -> why.
    """
    if not effects or "refined.xml" not in files:
        return ""
    pronoun = "it" if len(effects) == 1 else "them"
    if "refined_model.py" in files:
        return f"refined.xml: {lacking(effects)}; refined_model.py adds {beside(effects, lost)}"
    return f"refined.xml: {lacking(effects)}" + (f"; refined.toml has {pronoun}" if "refined.toml" in files else "")


def file_error(result: Criticism, files: Sequence[str]) -> str:
    """Compare the held-out error of refined.xml with that of the whole model; empty where it is the whole."""
    if "refined_model.py" not in files or not result.file_error:
        return ""
    signal = worst_signal(result)
    bare, whole = errors_of_files(result, signal)
    return f"{signal} on held-out runs: refined.xml by itself {bare}, the whole model {whole}"


def errors_of_files(result: Criticism, signal: str) -> tuple[str, str]:
    """Held-out error of refined.xml by itself and of the whole model, in one unit."""
    bare, whole = result.file_error[signal], result.heldout_error.after[signal]
    if not math.isfinite(bare) or not math.isfinite(whole):
        return quantities.text(bare, result.units[signal]), quantities.text(whole, result.units[signal])
    one, other = quantities.texts((bare, whole), result.units[signal])
    return one, other


def beside(effects: Mapping[str, str], lost: Mapping[str, str]) -> str:
    """List what refined_model.py adds to refined.xml, and what it lacks as well.

    Args:
        effects: keys of the effects that refined.xml cannot hold.
        lost: those that refined_model.py cannot hold -> why, as a clause.
    """
    held = [key for key in effects if key not in lost]
    has = listing(held) if held else "the final model's own integration"
    return f"{has} ({lacking(lost)})" if lost else has


def lacking(effects: Mapping[str, str]) -> str:
    """``without a and b, which plain MuJoCo has no term for``, for each reason once; empty without any effect."""
    reasons = dict.fromkeys(effects.values())
    keys = {why: [key for key, reason in effects.items() if reason == why] for why in reasons}
    return "; ".join(f"without {listing(keys[why])}, {why}" for why in reasons)


def bounds(result: Criticism) -> list[str]:
    """One sentence for each bound that excludes the truth: the value that the data ask for, and what to write."""
    sentences = []
    for name, widened in result.widened.items():
        low, high = (quantities.exact(value, result.parameters[name].unit) for value in widened.before)
        wide = ", ".join(f"{value:g}" for value in widened.after)
        sentences.append(
            f"The data ask for {name} = {estimate(result.parameters[name])}; the bounds were {low} to {high}. If that "
            f'can be, write "{address_of(name)}" = [{wide}] under [parameters]; if it cannot, look for what acts '
            "like it. The held-out error after is that of the model with all such bounds widened."
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
        others = f" Values of {listing(list(change.equals), 'or')} would do as well." if change.equals else ""
        sentences.append(
            f"{change.parameter} differs between runs: {listing(shown)}, where one value for all was "
            f"{quantities.text(change.shared, unit)}; with a value in every run the cross-validated error falls by "
            f"{quantities.percent(change.rms_fall[0])}.{others}"
        )
    return sentences


def remainder(result: Criticism) -> str:
    """Describe the residual after the accepted effects."""
    ratio = max(result.remainder.rms_over_floor.values(), default=math.nan)
    if result.remainder.status == "noise":
        return f"What is left looks like noise ({quantities.times(ratio)} the sensor noise)."
    where = f"; it concentrates {region_words.in_words(result.remainder.where)}" if result.remainder.where else ""
    return f"What is left is not noise, {quantities.times(ratio)} the sensor noise{where}."


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
    return f"The model misses {signal} by {size} over {horizon}, {times_floor(ratio)}."
