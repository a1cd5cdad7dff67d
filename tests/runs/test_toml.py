"""What is written parses to the same values."""

from __future__ import annotations

import datetime
import tomllib

import pytest

from onlinebayes.runs import to_toml


@pytest.mark.parametrize(
    "content",
    [
        {"schema": 1, "model": "a b.xml", "on": True, "x": 1e-7, "list": [1, 2.5, "c"], "none": []},
        {"text": 'quote " back \\ slash / tab \t line \n umlaut ü smile \U0001f600 del \x7f'},
        {"parameters": {"joint.*.damping": {"low": 0.0, "high": 2.0, "tie": True}, "body.x.mass": [50.0, 150.0]}},
        {"signals": {"qpos.carriage": {"sd": 1e-5, "column": "position"}}, "runs": {"kp*": {"actuator.a.kp": 1.9}}},
        {"a": {"b": {"c": {"d": 1}}}, "empty": {}},
        {"when": datetime.date(2024, 2, 29), "big": 10**15, "inf": float("inf")},
    ],
)
def test_round_trip(content: dict) -> None:
    assert tomllib.loads(to_toml(content)) == content


def test_comments_stand_behind_their_values() -> None:
    text = to_toml({"parameters": {"m": [0, 1]}}, head="one\ntwo", comments={("parameters", "m"): "fitted: 0.5"})
    assert text.startswith("# one\n# two\n")
    assert "m = [0, 1]  # fitted: 0.5" in text


def test_what_toml_lacks_is_refused() -> None:
    with pytest.raises(TypeError, match="NoneType"):
        to_toml({"a": None})
