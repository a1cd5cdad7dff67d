"""``[starts]`` of a problem file: what is known of how runs begin, globs and numbers among it, and bad entries."""

from __future__ import annotations

import pytest

from onlinebayes.measurements import KnownStart
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from tests.problems.conftest import PROBLEM


def starting(folder, *lines: str):
    """The problem with these lines under ``[starts]``."""
    path = folder / "carriage.toml"
    path.write_text("\n".join([PROBLEM, "[starts]", *lines]))
    return path


def test_numbers_tables_and_globs(folder):
    assert load_problem(folder / "carriage.toml").measurement.starts == {}
    exact = load_problem(starting(folder, '"q*.carriage" = 0')).measurement.starts
    assert exact == {"qpos.carriage": KnownStart(0.0), "qvel.carriage": KnownStart(0.0)}
    lines = ('"qpos.carriage" = { value = 0.1, sd = 0.01 }', '"qvel.carriage" = { sd = 0.2 }')
    assert load_problem(starting(folder, *lines)).measurement.starts == {
        "qpos.carriage": KnownStart(0.1, 0.01),
        "qvel.carriage": KnownStart(sd=0.2),
    }


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (['"qvel.carrage" = 0'], r'starts\."qvel\.carrage": .*no such coordinate; nearest: qvel\.carriage'),
        (['"qvel.carriage" = "rest"'], r"starts.*is not a number"),
        (['"qvel.carriage" = { sd = -0.1 }'], r'starts\."qvel\.carriage": sd = -0\.1 is no standard deviation'),
        (['"qvel.carriage" = {}'], "neither a value nor an sd"),
        (['"qvel.carriage" = { vlaue = 0 }'], "unknown key; nearest: value"),
        (['"qvel.carriage" = { value = inf }'], "not finite"),
        (['"qvel.*" = 0', '"q*.carriage" = 1'], r"'qvel\.carriage' is told by 'qvel\.\*' already"),
    ],
)
def test_bad_entries_name_their_key(folder, lines, message):
    with pytest.raises(BadInput, match=message):
        load_problem(starting(folder, *lines))
