"""The planner's recipe and its study, small."""

from __future__ import annotations

from pathlib import Path

import pytest

from recipes import swing_up
from recipes.studies import planner


@pytest.mark.slow
def test_a_planner_that_has_learnt_swings_up_as_one_that_knows(tmp_path: Path) -> None:
    assert swing_up.main(swing_up.Settings(system="pendulum", short=True, out=str(tmp_path))) == 0
    assert (tmp_path / "swing_up-pendulum-0-short" / "run.html").exists()


@pytest.mark.slow
def test_the_upper_factor_has_another_covariance() -> None:
    """What the study shows beside the right points is DISCO's mistake, and nothing else."""
    draws = planner.Correlated().sample((400,))
    wanted = (draws - draws.mean(0)).T @ (draws - draws.mean(0)) / len(draws)
    for risk, right in ((planner.RISKS["unscented"], True), (planner.RISKS["unscented, upper factor"], False)):
        points, weights = risk.worlds(draws, 5, planner.torch.Generator())
        found = (points - draws.mean(0)).T @ (weights[:, None] * (points - draws.mean(0)))
        assert planner.torch.allclose(found, wanted) == right
