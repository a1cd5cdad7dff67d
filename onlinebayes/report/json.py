"""report.json: the result as other programs read it, schema 1. Every number is finite; what is not known is null.

The keys up to ``numerics`` are the contract's and stay as they are; the others may grow. Those of which the search has
nothing to say any more (``p_value``, ``homogeneous``, ``rms_fall``, ``accepted_with``) stand there empty.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from onlinebayes.criticism import Candidate, Criticism, ParameterChange, WeightedModel, moments_of
from onlinebayes.identification import Estimate, FittedModel, Fleet
from onlinebayes.runs.results import machine, versions

SCHEMA = 1


def to_json(result: Criticism) -> str:
    """The text of report.json."""
    return json.dumps(_finite(to_dict(result)), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def to_dict(result: Criticism) -> dict[str, Any]:
    """The content of report.json, numbers as they are."""
    return {
        "schema": SCHEMA,
        "versions": versions(),
        "verdict": result.verdict,
        "accepted": result.accepted,
        "remainder": asdict(result.remainder),
        "heldout_error": asdict(result.heldout_error),
        "steps": [asdict(step) for step in result.steps],
        "candidates": [_candidate(candidate) for candidate in result.candidates],
        "candidates_tried": result.candidates_tried,
        "holdout_looks": result.holdout_looks,
        "failures": [asdict(failure) for failure in result.failures],
        "parameters": _estimates(result.parameters),
        "flat_directions": [asdict(direction) for direction in result.flat_directions],
        "numerics": asdict(result.numerics),
        "command": result.command,
        "signals": {
            signal: {"unit": result.units[signal], "sensor_sd": result.sensor_sd[signal]} for signal in result.signals
        },
        "held_out_runs": result.held_out_runs,
        "base_parameters": _estimates(result.base.parameters),
        "selection": asdict(result.selection),
        "what_to_record": result.what_to_record,
        "interrupted": result.interrupted,
        "failed": result.failed,
        "notes": result.notes,
        "widened": {name: asdict(bounds) for name, bounds in result.widened.items()},
        "detail": asdict(result.detail),
        "timings": [asdict(timing) for timing in result.timings],
        "wiring": None if result.wiring is None else asdict(result.wiring),
        "changes": [_change(change) for change in result.changes],
        "delays": [asdict(delay) for delay in result.delays],
        "fleet": {address: _fleet(fleet) for address, fleet in result.fleet.items()},
        "hypotheses": [_hypothesis(one) for one in result.hypotheses],
        "integration": None if result.integration is None else asdict(result.integration),
        "refined_xml_error": result.file_error or None,
        "machine": machine(),
    }


def _candidate(candidate: Candidate) -> dict[str, Any]:
    return {
        "effect": candidate.effect,
        "rank": candidate.rank,
        "score_gain": candidate.score_gain,
        "score_gain_se": candidate.score_gain_se,
        "n_blocks": candidate.n_blocks,
        "p_value": candidate.p_value,
        "homogeneous": None,
        # "identifiable" and "at_bound" are said of the final model only.
        "parameters": _estimates(candidate.parameters, of_the_model=False),
        "indistinguishable_from": candidate.indistinguishable_from,
        "nested_in": candidate.nested_in,
        "exclusion_limit": candidate.exclusion_limit,
        "confounded_with": candidate.confounded_with,
        "accepted": candidate.accepted,
        "probability": candidate.probability,
        "accepted_with": (),
        "rms_fall": None,
        "refused_because": candidate.refused_because,
    }


def _fleet(fleet: Fleet) -> dict[str, Any]:
    whole = {"mean": fleet.mean, "spread": fleet.spread, "next": fleet.next}
    return {
        **_estimates(whole, of_the_model=False),
        "units": _estimates(fleet.units, of_the_model=False),
        "left_out": fleet.left_out,
    }


def _hypothesis(one: WeightedModel) -> dict[str, Any]:
    return {
        "weight": one.weight,
        "accepted": one.accepted,
        "parameters": _estimates(one.model.parameters),
        "belief": _belief(one.model),
    }


def _belief(model: FittedModel) -> dict[str, Any]:
    """What is known of the parameters together, under the simulator's own names; of runs that differ, the next one."""
    space, mean, covariance = moments_of(model)
    sd = covariance.diagonal().clamp_min(0).sqrt()
    correlation = covariance / (sd[:, None] * sd).clamp_min(1e-300)
    return {
        "names": space.names,
        "mean": mean.tolist(),
        "sd": sd.tolist(),
        "correlation": correlation.clamp(-1, 1).fill_diagonal_(1.0).tolist(),
    }


def _change(change: ParameterChange) -> dict[str, Any]:
    return {**asdict(change), "values": _estimates(change.values), "groups": ()}


def _estimates(estimates: Mapping[str, Estimate], *, of_the_model: bool = True) -> dict[str, dict[str, Any]]:
    left_out = () if of_the_model else ("identifiable", "at_bound")
    return {
        name: {key: value for key, value in asdict(estimate).items() if key not in left_out}
        for name, estimate in estimates.items()
    }


def _finite(value: Any) -> Any:
    """The same with null for what JSON has no number for."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return value
