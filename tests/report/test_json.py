"""report.json: the contract's keys, finite numbers, nothing rounded."""

from __future__ import annotations

import dataclasses
import json
import math

import pytest

from onlinebayes.report.json import to_json
from tests.report.synthetic import SIGNAL, changed, criticism

CONTRACT = [
    "schema", "versions", "verdict", "accepted", "remainder", "heldout_error", "steps", "candidates",
    "candidates_tried", "holdout_looks", "failures", "parameters", "flat_directions", "numerics",
]  # fmt: skip


def load(text: str) -> dict:
    """Parse as a strict reader does: no NaN, no Infinity."""

    def refuse(name: str) -> float:
        raise AssertionError(f"{name} is not JSON")

    return json.loads(text, parse_constant=refuse)


def test_the_contracts_keys_stand_first_and_in_order() -> None:
    assert list(load(to_json(criticism())))[: len(CONTRACT)] == CONTRACT


def test_values_are_the_results_own() -> None:
    result = criticism()
    found = load(to_json(result))
    assert found["schema"] == 1
    assert found["verdict"] == "missing_effect"
    assert found["accepted"] == ["dry_friction@carriage", "constant_load@carriage"]
    assert all(candidate["probability"] is None for candidate in found["candidates"])
    assert found["heldout_error"]["before"] == {SIGNAL: result.heldout_error.before[SIGNAL]}
    assert found["heldout_error"]["horizon_s"] == {SIGNAL: 1.0}
    assert found["remainder"] == {
        "status": "structured", "rms_over_floor": {SIGNAL: 4.1}, "where": result.remainder.where,
    }  # fmt: skip
    assert set(found["steps"][0]) == {
        "added", "error_before", "error_after", "score_gain", "score_gain_se", "n_blocks",
    }  # fmt: skip
    assert set(found["parameters"]["body.carriage.mass"]) == {
        "mean", "sd", "q05", "q95", "unit", "identifiable", "at_bound",
    }  # fmt: skip
    assert found["failures"][0] == {
        "signal": SIGNAL, "where": "|qvel.carriage| < 0.02 m/s", "share_of_error": 0.6, "share_of_time": 0.1,
    }  # fmt: skip


def test_candidates_hold_what_the_contract_lists() -> None:
    first, *_, last = load(to_json(criticism()))["candidates"]
    for key in (
        "effect", "rank", "score_gain", "score_gain_se", "n_blocks", "p_value", "homogeneous", "parameters",
        "indistinguishable_from", "nested_in", "exclusion_limit",
    ):  # fmt: skip
        assert key in first
    assert set(first["parameters"]["frictionloss"]) == {"mean", "sd", "q05", "q95", "unit"}
    assert last["rank"] is None
    assert last["confounded_with"] == ["joint.carriage.damping"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_numbers_that_json_lacks_become_null(value: float) -> None:
    result = criticism()
    errors = dataclasses.replace(result.heldout_error, after={SIGNAL: value})
    found = load(to_json(dataclasses.replace(result, heldout_error=errors)))
    assert found["heldout_error"]["after"] == {SIGNAL: None}


def test_changes_between_runs_are_listed() -> None:
    (change,) = json.loads(to_json(changed(criticism())))["changes"]
    assert change["parameter"] == "body.carriage.mass"
    assert change["values"]["plain"]["mean"] == 92.0
    assert change["lines"].endswith('scope = "per_run" }')
    assert json.loads(to_json(criticism()))["changes"] == []
