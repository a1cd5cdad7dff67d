"""Bounds that are proposed hold what the data ask for well inside, and are of its order."""

from __future__ import annotations

import pytest

from onlinebayes.criticism.findings.answers import proposed_bounds
from onlinebayes.identification.results import Estimate
from onlinebayes.parameters import Parameter


@pytest.mark.parametrize(
    ("before", "tried", "mean", "sd", "proposed"),
    [
        ((4.0, 8.0), (4.0, 48.0), 8.398, 0.003, (4.0, 17.0)),
        ((4.0, 8.0), (4.0, 48.0), 9.0, 2.0, (4.0, 29.0)),  # ten sd
        ((4.0, 8.0), (0.4, 8.0), 3.1, 0.01, (1.6, 8.0)),
        ((4.0, 8.0), (0.4, 8.0), 0.9, 0.2, (0.4, 8.0)),  # a mass is never negative
        ((-0.2, 0.1), (-0.2, 3.1), 0.15, 0.01, (-0.2, 0.3)),
        ((-0.2, -0.1), (-0.2, 0.9), -0.05, 0.001, (-0.2, -0.025)),
        ((-0.2, 0.1), (-3.2, 0.1), -0.3, 0.001, (-0.6, 0.1)),
    ],
)
def test_the_proposed_bound(
    before: tuple[float, float], tried: tuple[float, float], mean: float, sd: float, proposed: tuple[float, float]
) -> None:
    value = Estimate(mean, sd, mean - 1.7 * sd, mean + 1.7 * sd, "kg")
    assert proposed_bounds(Parameter(*before, "kg"), Parameter(*tried, "kg"), value) == pytest.approx(proposed)
