"""Runs with like values are named as groups; values that differ from run to run are not."""

from __future__ import annotations

import pytest

from onlinebayes.criticism.findings.like_runs import globs, like_runs
from onlinebayes.identification.results import Estimate


def values(sd: float = 0.001, **means: float) -> dict[str, Estimate]:
    return {run: Estimate(mean, sd, mean - 1.7 * sd, mean + 1.7 * sd, "kg") for run, mean in means.items()}


def test_two_tools_are_two_groups_in_the_order_of_the_runs() -> None:
    found = like_runs(values(n0=0.752, t0=1.0, n1=0.750, t1=1.002, n2=0.751, t2=0.999))
    assert found == (("n0", "n1", "n2"), ("t0", "t1", "t2"))
    assert globs(found) == ("n*", "t*")


@pytest.mark.parametrize(
    "means",
    [
        {"a": 1.0, "b": 2.0},  # two runs are no groups
        {"a": 1.0, "b": 1.004, "c": 1.008},  # less than 5 sd apart
        {"a": 1.0, "b": 2.0, "c": 3.0},  # every run its own
        {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0, "e": 4.0},  # four levels
        {},
    ],
)
def test_what_is_no_matter_of_groups(means: dict[str, float]) -> None:
    assert like_runs(values(**means)) == ()


def test_a_value_that_happens_to_look_certain_parts_nothing() -> None:
    known = values(a=1.0, b=1.001, c=2.0, d=2.003) | values(sd=1e-6, e=1.0005, f=2.001)
    assert like_runs(known) == (("a", "b", "e"), ("c", "d", "f"))


@pytest.mark.parametrize(
    ("groups", "named"),
    [
        ([["r1-a", "r2-a"], ["r1-b", "r2-b"]], ()),  # their names begin alike
        ([["light-1", "light-2"], ["heavy"]], ("light-*",)),  # a run alone needs no glob
        ([["r10", "r11"], ["r20", "r21"]], ("r1*", "r2*")),
        ([["0", "01"], ["1", "12"]], ("0*", "1*")),
        ([["a*", "a?"], ["b", "b2"]], ()),  # names that are globs themselves
        ([], ()),
    ],
)
def test_globs_part_the_groups_or_are_left_out(groups: list[list[str]], named: tuple[str, ...]) -> None:
    assert globs(groups) == named
