"""The fixed part of `make blind`: one set of each cheap kind, judged as the study judges all 100."""

import pytest

from recipes.studies.blind import Outcome, Study, judge, table


@pytest.mark.slow
def test_nothing_is_named_where_nothing_hides() -> None:
    assert judge("null", 0).named


@pytest.mark.slow
def test_what_is_hidden_is_named() -> None:
    outcome = judge("actuator_delay", 0)
    assert outcome.named
    assert outcome.improved
    assert outcome.at_truth < 2  # the true parameters explain the held-out run, but for its starts
    assert 2 <= outcome.before <= 10


@pytest.mark.parametrize(
    ("kind", "seed"),
    [
        pytest.param("dry_friction", 0, marks=pytest.mark.long),
        pytest.param("quadratic_drag", 1, marks=pytest.mark.long),
        pytest.param("null", 1, marks=pytest.mark.long),
    ],
)
def test_more_of_the_blind_sets(kind: str, seed: int) -> None:
    outcome = judge(kind, seed)
    assert outcome.named
    assert kind == "null" or outcome.improved


def test_the_table_counts_what_failed() -> None:
    right = Outcome(
        "dry_friction", 0, "missing_effect", "dry_friction@hinge", "dry_friction@hinge", True, 4.0, 1.1, 1.1, 9.0
    )
    wrong = Outcome("dry_friction", 1, "unexplained", "quadratic_drag@hinge", "", False, 4.0, 4.0, 1.0, 9.0)
    quiet = Outcome("null", 0, "adequate", "dry_friction@hinge", "", True, 1.0, 1.0, 1.0, 5.0)
    loud = [Outcome("null", k, "missing_effect", "a@b", "a@b", False, 1.0, 1.0, 1.0, 5.0) for k in (1, 2)]
    good = {row.name: row for row in table([right, quiet], Study(hidden=1, null=1)).rows}
    bad = {row.name: row for row in table([right, wrong, quiet, *loud], Study(hidden=1, null=3)).rows}
    named, false = "hidden effect ranked first and accepted", "null sets with something accepted"
    assert (good[named].value, good[named].holds, good[false].holds) == (1, True, True)
    assert (bad[named].value, bad[named].holds) == (1, False)
    assert (bad[false].value, bad[false].holds) == (2, False)
