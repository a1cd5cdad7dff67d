"""The candidates as the report lists them: accepted ones in their order, then the others by what they would add now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from onlinebayes.criticism.candidates.survey import Screened
from onlinebayes.criticism.judging.acceptance import Judged, contained
from onlinebayes.criticism.results import HELPS, NOT_NEEDED, STOPPED, Candidate, Step
from onlinebayes.criticism.searching.search import SearchResult
from onlinebayes.criticism.searching.stage import LEAST_PROMISED_FALL, REFIT_BELOW, Stage
from onlinebayes.identification.fitting.identifiability import covariance_of, estimates
from onlinebayes.identification.replaying.scoped import effect_entries
from onlinebayes.identification.results import Estimate


def rank(
    found: SearchResult, equal: Mapping[str, tuple[str, ...]], final: Mapping[str, Estimate]
) -> tuple[Candidate, ...]:
    """Every candidate, the best first, the confounded ones last.

    Args:
        found: what the search found.
        equal: accepted effect -> those it cannot be told from.
        final: parameters of the final model; an accepted effect has its values there, others those of their own refit.
    """
    if not found.stages:
        return tuple(Candidate(effect.key, None, None, None, None, 0) for effect in found.effects)
    rows: list[Candidate] = []
    for stage, judged in found.accepted:
        row = _judged(stage, judged, len(rows) + 1, equal, accepted=True)
        own = {name: final.get(f"{row.effect}.{name}", value) for name, value in row.parameters.items()}
        rows.append(replace(row, parameters=own, accepted_with=_partners(found, judged)))
    last = found.stages[-1]
    tried = {screened.effect.key for screened in last.screened}
    for stage, judged in found.accepted:  # equals that are no candidates of the last round: zeros, changes in time
        for rival in stage.judged:
            if rival.effect.key in equal.get(judged.effect.key, ()) and rival.effect.key not in tried:
                rows.append(_judged(stage, rival, len(rows) + 1, equal, accepted=False))
    listed = {row.effect for row in rows}
    verdicts = {judged.effect.key: judged for judged in last.judged}
    order = sorted(last.screened, key=lambda s: _place(s, verdicts.get(s.effect.key)))
    left = [screened for screened in order if screened.effect.key not in listed]
    for screened in left:
        if (refitted := verdicts.get(screened.effect.key)) is not None:
            row = _judged(last, refitted, len(rows) + 1, equal, accepted=False, screened=screened)
            if not row.refused_because and not row.indistinguishable_from:
                row = replace(row, refused_because=(STOPPED if found.interrupted else NOT_NEEDED,))
            rows.append(row)
    listed = {row.effect for row in rows}
    for stage, judged in found.taken_back:  # before what was screened beside it: it may be part of the answer
        if judged.effect.key not in listed:
            row = _judged(stage, judged, len(rows) + 1, equal, accepted=False)
            rows.append(replace(row, refused_because=(_not_all(judged),)))
    listed = {row.effect for row in rows}
    rows += [
        _only_screened(last, screened, len(rows) + 1 + k, equal)
        for k, screened in enumerate(one for one in left if one.effect.key not in listed)
    ]
    listed = {row.effect for row in rows}
    late = ("tried last: it does not leave noise",)
    rows += [
        Candidate(effect.key, None, None, None, None, last.blocks.count, refused_because=late)
        for effect in found.effects
        if effect.key not in listed
    ]
    richer = {effect.key: contained(effect) for effect in found.effects}
    return tuple(
        replace(row, nested_in=tuple(key for key, simpler in richer.items() if row.effect in simpler)) for row in rows
    )


def _only_screened(last: Stage, screened: Screened, number: int, equal: Mapping[str, tuple[str, ...]]) -> Candidate:
    key = screened.effect.key
    return Candidate(
        key,
        None if screened.p_value is None else number,
        screened.p_value,
        None,
        None,
        last.blocks.count,
        refused_because=_not_refitted(screened),
        confounded_with=screened.confounded_with,
        exclusion_limit=screened.exclusion_limit,
        indistinguishable_from=_equals(key, equal),
    )


def _not_all(judged: Judged) -> str:
    """Why what stood on trial is not in the model."""
    return f"{HELPS}: the error falls by {100 * judged.falls[0]:.0f} %, and what is left is not noise"


def _partners(found: SearchResult, judged: Judged) -> tuple[str, ...]:
    """What was accepted beside an effect that would not have been alone: see :mod:`.searching.pairs`."""
    key = judged.effect.key
    if judged.admissible:
        return ()
    beside = [(stage, other.effect.key) for stage, other in found.accepted if other is not judged]
    return tuple(other for stage, other in beside if key in {e.key for e in stage.current.simulator.effects})[:1]


def steps(found: SearchResult) -> tuple[Step, ...]:
    """The acceptances in order, errors cross-validated inside the fit runs [the signals' units]."""
    taken = []
    for stage, judged in found.accepted:
        noise = stage.windows.noise / stage.windows.bin_rows**0.5
        names = [stage.current.simulator.signals[c] for c in stage.windows.columns]
        before, after = (
            dict(zip(names, (scores.signal_rms * noise).tolist(), strict=True))
            for scores in (stage.scores, judged.scores)
        )
        taken.append(Step(judged.effect.key, before, after, judged.gain.gain, judged.gain.se, judged.gain.blocks))
    return tuple(taken)


def _not_refitted(screened: Screened) -> tuple[str, ...]:
    """Why screening was the end of it, in words; empty for a confounded effect."""
    if screened.p_value is None:
        return ()
    if screened.p_value < REFIT_BELOW:
        why = "too weak" if screened.promise < LEAST_PROMISED_FALL else "not refitted"
        return (f"{why}: it would lower the error by {100 * screened.promise:.1f} % (p = {screened.p_value:.2g})",)
    return (f"not significant (p = {screened.p_value:.2g})",)


def _place(screened: Screened, judged: Judged | None) -> tuple[bool, bool, float, float]:
    """Confounded last; judged before the others, by their gain; the others by p and z."""
    if screened.p_value is None:
        return (True, True, 0.0, 0.0)
    if judged is not None:
        return (False, False, -judged.gain.gain, 0.0)
    return (False, True, screened.p_value, -(screened.z or 0.0))


def _judged(
    stage: Stage,
    judged: Judged,
    number: int,
    equal: Mapping[str, tuple[str, ...]],
    *,
    accepted: bool,
    screened: Screened | None = None,
) -> Candidate:
    key = judged.effect.key
    return Candidate(
        key,
        number,
        judged.p_value,
        judged.gain.gain,
        judged.gain.se,
        judged.gain.blocks,
        judged.falls,
        judged.homogeneous,
        accepted,
        () if accepted else judged.failed,
        _own_estimates(stage, judged),
        _equals(key, equal),
        exclusion_limit=None if screened is None or accepted else screened.exclusion_limit,
    )


def _equals(key: str, equal: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    return (*equal.get(key, ()), *(other for other, members in equal.items() if key in members))


def _own_estimates(stage: Stage, judged: Judged) -> dict[str, Estimate]:
    covariance = covariance_of(judged.fitted, stage.blocks)
    every = estimates(judged.fitted, covariance, stage.blocks.count, ())
    own = effect_entries(judged.fitted.simulator, judged.effect)
    return {entry.removeprefix(f"{judged.effect.key}."): every[entry] for entry in own}
