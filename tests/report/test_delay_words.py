"""A delay in words: each of four stages, and the recordings that tell more, in the page and in report.json."""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.criticism import DelayPlace, DriftSeen, LocatedDelay
from onlinebayes.report import delay_words
from onlinebayes.report.html import to_html
from onlinebayes.report.json import to_dict
from tests.report.synthetic import criticism

DELAY = LocatedDelay(
    "actuator_delay@motor",
    "command",
    (
        DelayPlace("command", "actuator_delay@motor", None),
        DelayPlace("torque", "actuator_lag@motor", True),
        DelayPlace("sensor", "sensor_delay@qpos.carriage", False),
        DelayPlace("clock", "", True),
    ),
    ("second_sensor", "release"),
    DriftSeen("qpos.carriage", 2e-6, 5e-6, 8e-7),
)


def test_each_stage_is_said_once_in_the_order_of_the_way_to_the_log() -> None:
    assert delay_words.rows(DELAY) == [
        ("transport of the command", "actuator delay at motor", "found"),
        ("lag of the torque", "actuator lag at motor", "told apart"),
        ("sensor", "sensor delay at qpos.carriage", "not told apart: it explains as much"),
        ("clock of the signals", "–", "told apart: its lag grows by 0.0020 ± 0.0050 ms/s"),
    ]


def test_recordings_are_those_that_tell_more() -> None:
    sensor, release = delay_words.recordings(DELAY)
    assert "second sensor" in sensor
    assert "enable.ACTUATOR" in release
    (minute,) = delay_words.recordings(replace(DELAY, recordings=("minute",)))
    assert minute.endswith("± 0.00080 ms/s.")


def test_page_and_json_hold_it_and_a_result_without_delay_does_not() -> None:
    result = replace(criticism(), delays=(DELAY,))
    assert "Where the delay is" in to_html(result)
    assert "Where the delay is" not in to_html(criticism())
    (written,) = to_dict(result)["delays"]
    assert written["places"][2] == {"stage": "sensor", "effect": "sensor_delay@qpos.carriage", "told_apart": False}
    assert written["drift"]["sd_of_a_minute"] == 8e-7
    assert to_dict(criticism())["delays"] == []
