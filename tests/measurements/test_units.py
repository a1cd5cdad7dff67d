"""Units become SI, or the line says which would."""

from __future__ import annotations

import math

import pytest

from onlinebayes.measurements.units import SI, to_si
from onlinebayes.runs import BadInput


@pytest.mark.parametrize(
    ("unit", "si", "value", "expected"),
    [
        ("mm", "m", 1500.0, 1.5),
        ("deg", "rad", 180.0, math.pi),
        ("rpm", "rad/s", 60.0, 2 * math.pi),
        ("rev", "rad", 0.5, math.pi),
        ("km/h", "m/s", 36.0, 10.0),
        ("rad", "", 1.0, 1.0),
    ],
)
def test_a_value_becomes_si(unit, si, value, expected):
    assert value * to_si(unit, si) == pytest.approx(expected)


def test_every_unit_leads_to_an_si_unit_of_factor_one():
    assert all(SI[si] == (si, 1.0) for si, _ in SI.values())


def test_unknown_and_unfitting_units_are_named():
    with pytest.raises(BadInput, match="unit 'degs' is unknown; nearest: deg"):
        to_si("degs")
    with pytest.raises(BadInput, match="unit 'mm' cannot become rad; use one of rad, mrad, deg, rev"):
        to_si("mm", "rad")


@pytest.mark.parametrize(
    ("unit", "wanted", "meant"),
    [
        ("degrees", "rad", "deg"),
        ("degrees", "", "deg"),
        ("Degrees per second", "rad/s", "deg/s"),
        ("dps", "", "deg/s"),
        ("radians", "rad", "rad"),
        ("millimeters", "m", "mm"),
        ("metres", "", "m"),
        ("seconds", "s", "s"),
        ("RPM", "", "rpm"),
        ("amps", "", "A"),
    ],
)
def test_a_unit_in_other_words_is_said_as_it_is_written(unit: str, wanted: str, meant: str) -> None:
    with pytest.raises(BadInput) as caught:
        to_si(unit, wanted)
    assert str(caught.value) == f"unit '{unit}' is unknown; nearest: {meant}"


def test_no_unit_of_another_quantity_is_suggested() -> None:
    with pytest.raises(BadInput, match="known: m, cm, mm, um"):
        to_si("degrees", "m")
