"""Where a delay is: a clock that drifts is named with its rate, a plain delay is none, and what a log tells apart."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from onlinebayes.criticism import Criticism, LocatedDelay, refine
from onlinebayes.criticism.findings.delays import ahead_of_commands
from onlinebayes.criticism.hypotheses import start_search
from onlinebayes.criticism.hypotheses.growing_lags import lag_growths
from onlinebayes.criticism.wiring.shifts import Shifted
from tests.criticism.late import SIGNAL, measure
from tests.criticism.wired import PENDULUM

CLOCK, SENSOR = f"sensor_clock@{SIGNAL}", f"sensor_delay@{SIGNAL}"
TRANSPORT, LAG = "actuator_delay@motor", "actuator_lag@motor"
FEW = ("sensor_delay", "actuator_delay", "actuator_lag", "dry_friction")


def found(candidates: str | Sequence[str] = FEW, **late: float | bool) -> Criticism:
    return refine(PENDULUM.model(), measure(**late), candidates=candidates, faults=False)  # type: ignore[arg-type]


def told(delay: LocatedDelay) -> dict[str, tuple[str, bool | None]]:
    return {place.stage: (place.effect, place.told_apart) for place in delay.places}


@pytest.fixture(scope="module")
def drifting() -> Criticism:
    return found("all", runs=4, seconds=10.0, drift=1e-3)


@pytest.fixture(scope="module")
def late() -> Criticism:
    return found("all", runs=8, seconds=3.0, sensor=0.02)


@pytest.mark.slow
def test_a_clock_that_drifts_is_named_with_its_rate_though_nobody_named_it(drifting: Criticism) -> None:
    assert drifting.accepted == (CLOCK,)
    assert drifting.parameters[f"{CLOCK}.rate"].mean == pytest.approx(1e-3, rel=0.1)
    assert drifting.remainder.status == "noise"
    (delay,) = drifting.delays
    assert told(delay) == {
        "command": (TRANSPORT, True),
        "torque": (LAG, True),
        "sensor": (SENSOR, True),
        "clock": (CLOCK, None),
    }
    assert delay.recordings == ("minute",)
    assert delay.drift is not None
    assert delay.drift.sd_of_a_minute < delay.drift.sd


@pytest.mark.slow
def test_a_plain_delay_of_the_sensor_is_no_clock(late: Criticism) -> None:
    (accepted,) = late.accepted
    equal = {accepted, *late.candidates[0].indistinguishable_from}
    assert SENSOR in equal
    assert CLOCK not in equal


@pytest.mark.slow
def test_a_lag_grows_where_it_does_and_not_where_it_stands() -> None:
    def growth(**late: float) -> tuple[float, bool]:
        search = start_search(PENDULUM.model(), measure(runs=4, seconds=8.0, **late))
        (one,) = lag_growths(search.base.fitted, search.evaluator.windows)
        return one.rate, one.certain

    rate, certain = growth(drift=1e-3)
    assert certain
    assert rate == pytest.approx(1e-3, rel=0.3)
    assert not growth()[1]


@pytest.fixture(scope="module")
def coasting() -> Criticism:
    return found(runs=6, seconds=3.0, transport=0.02, coasts=True)


@pytest.fixture(scope="module")
def driven() -> Criticism:
    return found(runs=6, seconds=3.0, transport=0.02)


@pytest.mark.slow
def test_a_motor_that_is_switched_off_parts_a_late_command_from_a_late_sensor(coasting: Criticism) -> None:
    (delay,) = coasting.delays
    assert delay.stage in ("command", "torque")
    assert told(delay)["sensor"] == (SENSOR, True)
    assert told(delay)["clock"] == ("", True)
    assert "second_sensor" not in delay.recordings


@pytest.mark.slow
def test_without_it_the_two_give_the_same_log(driven: Criticism) -> None:
    (delay,) = driven.delays
    assert TRANSPORT in {place.effect for place in delay.places if place.told_apart is not True}
    assert SENSOR in {place.effect for place in delay.places if place.told_apart is not True}
    assert delay.recordings[:2] == ("second_sensor", "release")


def test_signals_ahead_of_the_commands_are_a_matter_of_clocks() -> None:
    (delay,) = ahead_of_commands(Shifted((SIGNAL,), -3, 0.01, every=True))
    assert delay.stage == "clock"
    assert told(delay) == {"command": ("", True), "torque": ("", True), "sensor": ("", True), "clock": ("", False)}
    assert ahead_of_commands(Shifted((SIGNAL,), 1, 0.01, every=True)) == ()
