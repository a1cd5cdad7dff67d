"""Every candidate of a search as the report lists it: what was added, what was tried, what was only screened."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from onlinebayes.criticism.hypotheses.additions import IN_EACH_RUN, AddedEffect, OwnValues
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.rounds import Round, Trial
from onlinebayes.criticism.hypotheses.screening import Prediction
from onlinebayes.criticism.results import MOVES_NOTHING, NOT_NEEDED, Candidate, Step
from onlinebayes.identification.judging.hypothesis import Addition, Hypothesis
from onlinebayes.identification.judging.rule import LEAST_GAIN
from onlinebayes.identification.results import Estimate
from onlinebayes.simulators.effects import EFFECTS


def ranked(explanation: Explanation, fitted: Mapping[str, Estimate], gone: Mapping[str, str]) -> tuple[Candidate, ...]:
    """All candidates, what was added first, then by what they gain, those that cannot be told from a parameter last.

    Args:
        explanation: the search.
        fitted: the parameters of what was found.
        gone: keys of what was taken out again -> why.
    """
    kept = laws(explanation.found.hypothesis)
    added = {found.added.addition.key: found for found in explanation.rounds if found.added is not None}
    rows = [_added(added[key], fitted) if key in added else _unjudged(key, explanation, fitted) for key in kept]
    own = {p.addition.key for one in explanation.rounds for p in one.screened if isinstance(p.addition, OwnValues)}
    known = {row.effect for row in rows}
    if not explanation.rounds:
        return tuple(rows)
    for row in (*_tried(explanation, known), *_screened(explanation.rounds[0], known)):
        if row.effect not in known | own:
            known.add(row.effect)
            rows.append(replace(row, refused_because=(gone[row.effect],)) if row.effect in gone else row)
    limits = {p.addition.key: _limit(p) for p in explanation.rounds[-1].screened}
    rows = [row if row.accepted else replace(row, exclusion_limit=limits.get(row.effect)) for row in rows]
    free = [row for row in rows if not row.confounded_with]
    numbered = [replace(row, rank=number) for number, row in enumerate(free, 1)]
    return (*numbered, *(row for row in rows if row.confounded_with))


def laws(found: Hypothesis) -> tuple[str, ...]:
    """Keys of what was added, without parameters that have one value a run: these are no law."""
    return tuple(one.key for one in found.additions if not isinstance(one, OwnValues))


def steps(explanation: Explanation) -> tuple[Step, ...]:
    """List the additions in order, with left-out errors inside the fit runs [the signals' units]."""
    windows = explanation.windows
    scale = windows.noise / windows.bin_rows**0.5
    names = [explanation.evaluator.given.signals[column] for column in windows.columns]
    taken = []
    for found in explanation.rounds:
        if found.added is None or found.added.addition.key not in laws(explanation.found.hypothesis):
            continue
        before, after = (
            dict(zip(names, (evaluation.left_out[0].rms * scale).tolist(), strict=True))
            for evaluation in (found.begun, found.added.evaluation)
        )
        first = found.added.gains[0]
        taken.append(Step(found.added.addition.key, before, after, first.gain, first.se, first.folds))
    return tuple(taken)


def equals(found: Round) -> tuple[str, ...]:
    """Keys of what cannot be told from what a round added, and is another law."""
    return tuple(dict.fromkeys(other.key for other in rivals(found)))


def rivals(found: Round) -> tuple[Addition, ...]:
    """List the other laws that cannot be told from what a round added.

    An own number is the effect that moves it, and a law that contains what was added is no rival of it.
    """
    assert found.added is not None
    mine = found.added.addition
    others = (other for other in found.equals if not contains(other, mine))
    return tuple(other for other in others if same_as(other.key) != same_as(mine.key))


def contains(richer: Addition, simpler: Addition) -> bool:
    """Check whether the richer effect becomes the simpler one for some of its values."""
    if not (isinstance(richer, AddedEffect) and isinstance(simpler, AddedEffect)):
        return False
    effect = richer.effect
    return simpler.effect.key in {f"{name}@{effect.element}" for name in effect.contains}


def same_as(key: str) -> str:
    """The effect that is the same law as an own number of the model, or one size a run of it; others as they are."""
    if "@" in key or not key.endswith(IN_EACH_RUN):
        key = key.removesuffix(IN_EACH_RUN)
    place, _, field = key.rpartition(".")
    kind, _, target = place.partition(".")
    for effect in EFFECTS.values():
        for k, number in enumerate(effect.same_law_as):
            if number == f"{kind}.*.{field}":
                return f"{effect.name}@{target}" + (f".{effect.axes[k]}" if effect.axes else "")
    return key


def _added(found: Round, fitted: Mapping[str, Estimate]) -> Candidate:
    trial = found.added
    assert trial is not None
    return replace(
        _refitted(trial),
        accepted=True,
        parameters=_values(trial.addition, fitted),
        indistinguishable_from=equals(found),
        nested_in=tuple(other.key for other in found.equals if contains(other, trial.addition)),
    )


def _unjudged(key: str, explanation: Explanation, fitted: Mapping[str, Estimate]) -> Candidate:
    """What stood in the model where the search was stopped, before it was asked what each addition gains."""
    addition = next(one for one in explanation.found.hypothesis.additions if one.key == key)
    folds = len(explanation.found.left_out[0].folds)
    return Candidate(key, 1, None, None, None, folds, accepted=True, parameters=_values(addition, fitted))


def _values(addition: Addition, fitted: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """Short name -> estimate of an addition's parameters."""
    own = addition.effect.key if isinstance(addition, AddedEffect) else addition.key
    return {
        name.removeprefix(f"{own}."): value
        for name, value in fitted.items()
        if name == own or name.startswith(f"{own}.")
    }


def _tried(explanation: Explanation, known: set[str]) -> Iterator[Candidate]:
    """Yield each addition that was refitted and is not in the model, as it stood in the last round in which it was."""
    last = {trial.addition.key: (found, trial) for found in explanation.rounds for trial in found.tried}
    left = [(found, trial) for key, (found, trial) in last.items() if key not in known]
    for found, trial in sorted(left, key=lambda pair: -pair[1].gains[0].gain):
        yield _refused(found, trial)


def _refitted(trial: Trial) -> Candidate:
    first = trial.gains[0]
    return Candidate(trial.addition.key, 1, None, first.gain, first.se, first.folds)


def _refused(found: Round, trial: Trial) -> Candidate:
    tied = found.added is not None and trial.addition.key in equals(found)
    return replace(
        _refitted(trial),
        refused_because=(trial.refused or NOT_NEEDED,),
        indistinguishable_from=(found.added.addition.key,) if tied and found.added is not None else (),
    )


def _screened(first: Round, known: set[str]) -> Iterator[Candidate]:
    """Yield the additions that were never refitted, by what they promised beside the base model."""
    folds = len(first.begun.left_out[0].folds)
    for prediction in first.screened:
        key = prediction.addition.key
        confounded = prediction.imitated_by if prediction.gain < LEAST_GAIN else ()
        yield Candidate(
            key,
            None if confounded else 1,
            None,
            None,
            None,
            folds,
            refused_because=() if confounded else (_promised(prediction),),
            confounded_with=confounded,
        )
    listed = known | {prediction.addition.key for prediction in first.screened}
    for key in first.silent:
        if key not in listed:
            yield Candidate(key, None, None, None, None, folds, confounded_with=(MOVES_NOTHING,))


def _limit(prediction: Prediction) -> float | None:
    """Return the largest effect that the data do not show, from neutral [SI]; None where its bounds allow no such.

    It means nothing of an effect that begins at its upper bound: a force's limit, which shrinks.
    """
    if not isinstance(prediction.addition, AddedEffect):
        return None
    effect = prediction.addition.effect
    bounds, neutral = effect.parameters[effect.magnitude], effect.neutral[effect.magnitude]
    if neutral >= bounds.high or prediction.visible > max(bounds.high - neutral, neutral - bounds.low):
        return None
    return prediction.visible


def _promised(prediction: Prediction) -> str:
    return f"not refitted: it promises a gain of {max(prediction.gain, 0.0):.3f}"
