"""The tables of the learning half's studies, from outcomes made up here; the studies themselves take hours."""

from __future__ import annotations

import math

import pytest
import torch

from onlinebayes.runs import BadInput, ResultTable
from recipes.studies import robustness, wall_clock
from recipes.studies.wall_clock import Outcome, Stopwatch


def test_the_ratio_is_taken_seed_by_seed_and_a_run_that_never_solved_is_infinitely_slow() -> None:
    seconds = {"ours": (2.0, 4.0, 3.0), "theirs": (20.0, 24.0, math.inf)}
    found = {("cartpole", s, side): Outcome(seconds[side][s], 500.0, 1.0) for side in seconds for s in range(3)}
    table = wall_clock.tabulate(wall_clock.Study(tasks=("cartpole",), seeds=(0, 1, 2)), found)
    (ratio,) = [row for row in table.rows if row.name == "cartpole: theirs over ours"]
    assert (ratio.value, ratio.spread, ratio.holds) == (10.0, "10 6 inf", True)


def test_what_is_aside_is_not_timed() -> None:
    watch = Stopwatch()
    begin = watch.seconds
    assert watch.aside(lambda: sum(float(i) for i in range(300_000))) == 44999850000.0
    assert watch.seconds - begin < 0.01


def test_near_and_far_are_told_apart() -> None:
    near = torch.tensor([True, True, False])
    returns = {"prior": torch.tensor([1.0, 3.0, 10.0]), "online": torch.tensor([5.0, 7.0, 2.0])}
    table = ResultTable("robustness", "make robustness", [1])
    robustness.told(table, "pendulum", [robustness.Grid(returns, near, torch.zeros(2))])
    found = {row.name: (row.value, row.holds) for row in table.rows}
    assert found["pendulum: online above prior, near the truth"] == (4.0, True)
    assert found["pendulum: online above prior, far from it"] == (-8.0, None)


def test_a_run_that_has_not_ended_is_asked_for(tmp_path) -> None:
    with pytest.raises(BadInput, match="run make online first"):
        robustness.judged(robustness.Study(runs=str(tmp_path)), "pendulum", 1)
