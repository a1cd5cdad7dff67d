"""The studies of posteriors: their tables from outcomes made up here, and a sample of each, small."""

from __future__ import annotations

import pytest

from onlinebayes.runs import ResultTable
from recipes.studies import calibration, ringing, table_online, tables
from recipes.studies.exact import coverage_error
from recipes.studies.table_systems import SYSTEMS


def rows_of(table: ResultTable) -> dict[str, tuple[float | str, bool | None]]:
    return {row.name: (row.value, row.holds) for row in table.rows}


def test_credibilities_that_are_uniform_have_no_coverage_error() -> None:
    uniform = [(i + 0.5) / 1000 for i in range(1000)]
    assert coverage_error(uniform) < 1e-3
    assert coverage_error([0.5 * alpha for alpha in uniform]) > 0.2


def test_the_alarm_is_judged_where_the_posterior_moved() -> None:
    table = ResultTable("calibration", "make calibration", [1])
    result = {"clean": [False] * 19 + [True], "rings": [True, False, True, True], "away": [3.0, 0.1, 2.5, 9.0]}
    calibration.add_alarm(table, "pendulum, alarm", result)
    found = rows_of(table)
    assert found["pendulum, alarm: rings on clean measurements"] == (0.05, True)
    assert found["pendulum, alarm: measurements whose posterior the effect moves by over 2 sd"] == (3, None)
    assert found["pendulum, alarm: rings on these"] == (1.0, True)


def test_what_is_not_in_the_dynamics_has_the_priors_density_for_its_goal() -> None:
    for middle, holds in ((0.04, True), (-0.2, False), (0.3, False)):
        table = ResultTable("tables", "make tables", [1])
        tables.add_goal(table, "Acrobot L2", {"mixture": [middle], "rejection": [5.0]}, -0.05)
        assert rows_of(table)["Acrobot L2: the mixture"] == (middle, holds)


@pytest.mark.slow
def test_a_sample_of_the_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {"SIMULATIONS": 300, "THETAS": 60, "COMBINED_BY": 20, "SIZES": (1, 3)}.items():
        monkeypatch.setattr(calibration, name, value)
    for estimator in calibration.ESTIMATORS:
        result = calibration.amortised("pendulum", estimator)
        # Of sixty exact credibilities the error is .04 in the mean; one in a thousand is above .13.
        assert coverage_error(result["ball 1"]) < 0.13, estimator
        # The prior has .21 nats.
        assert sum(result["density 1"]) / 60 > 0.5, estimator


@pytest.mark.slow
def test_the_alarm_rings_where_an_effect_misleads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ringing, "MEASUREMENTS", 20)
    monkeypatch.setattr(ringing, "SIMULATIONS", 400)
    result = ringing.way("pendulum", 521, 0.01)
    moved = [ring for ring, away in zip(result["rings"], result["away"], strict=True) if away > 2]
    # Sixty of each kind, .05 expected on clean ones: a seventh would be 3.5 standard errors away.
    assert sum(result["clean"]) / len(result["clean"]) < 1 / 7
    assert sum(moved) / len(moved) > 0.8


@pytest.mark.long
def test_the_length_that_does_nothing_stays_as_unknown_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "SEEDS", (541,))
    found = tables.columns("Acrobot L2", 541)["length2"]
    # Its width is 1 and the prior's density 0: what is above or below is invented.
    assert abs(found["mixture"]) < 0.1
    assert SYSTEMS["Acrobot L2"].rows["length2"][0] == -0.148  # the thesis's


@pytest.mark.slow
def test_an_online_run_ends_above_the_thesiss_figure() -> None:
    ended = table_online.ended("CartPole", 0.0, 1)
    assert ended["ours"] > table_online.ROWS["CartPole"].thesis
    assert ended["ours"] > ended["prior"]
