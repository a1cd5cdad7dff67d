"""Numbers for readers: prefix, digits, unit."""

from __future__ import annotations

import math

import pytest

from onlinebayes.identification.quantities import exact, percent, scale_for, significant, text, texts, times, with_error


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (0.00656, "m", "6.6 mm"),
        (0.0002, "m", "200 µm"),
        (0.9996e-3, "m", "1.0 mm"),
        (1.5, "m", "1.5 m"),
        (-0.0123, "rad", "-12 mrad"),
        (3e-12, "m", "0.0030 nm"),
        (0.0, "m", "0 m"),
        (0.0012, "N m", "0.0012 N m"),
        (2.3e-5, "N m", "2.3e-5 N m"),
        (123456.0, "N", "123456 N"),
        (0.25, "", "0.25"),
        (math.nan, "m", "–"),
        (None, "m", "–"),
    ],
)
def test_text(value: float | None, unit: str, expected: str) -> None:
    assert text(value, unit) == expected


@pytest.mark.parametrize(
    ("mean", "sd", "unit", "expected"),
    [
        (22.04, 0.93, "N", "22.0 ± 0.9 N"),
        (95.13, 1.52, "kg", "95.1 ± 1.5 kg"),
        (203.2, 6.2, "N s/m", "203 ± 6 N s/m"),
        (1234.0, 56.0, "N", "1230 ± 60 N"),
        (0.0123, 0.0004, "s", "12.3 ± 0.4 ms"),
        (2.31e-5, 4e-7, "kg", "(2.31 ± 0.04)e-5 kg"),
        (0.0, 0.3, "N", "0.0 ± 0.3 N"),
        (0.0, 1.3e-15, "N s/m", "0 N s/m"),
        (1.5, 0.0, "N", "1.500 N"),
        (math.nan, 1.0, "N", "–"),
    ],
)
def test_with_error(mean: float, sd: float, unit: str, expected: str) -> None:
    assert with_error(mean, sd, unit) == expected


@pytest.mark.parametrize(
    ("values", "unit", "expected"),
    [
        ((4.1, 0.0046, 0.0056), "rad", ["4100 mrad", "4.6 mrad", "5.6 mrad"]),
        ((1.5e-3, 5e-6), "m", ["1500 µm", "5.0 µm"]),
        ((0.00656, 0.00199, 0.0002), "m", ["6.6 mm", "2.0 mm", "0.20 mm"]),
        ((0.08, 9.3e-5), "m", ["80 mm", "0.093 mm"]),
        ((0.35, 2e-6), "m", ["350 mm", "0.0020 mm"]),
        ((4.0, 1e-9), "rad", ["4000 mrad", "1.0e-6 mrad"]),
        ((0.5, 1e-5), "N m", ["0.50 N m", "1.0e-5 N m"]),
        ((0.0, math.nan, 2e-3), "m", ["0 mm", "–", "2.0 mm"]),
        ((math.inf, 2e-3), "m", ["–", "2.0 mm"]),
        ((), "m", []),
    ],
)
def test_numbers_to_be_compared_share_a_unit(values: tuple[float, ...], unit: str, expected: list[str]) -> None:
    assert texts(values, unit) == expected


def test_rounding_up_keeps_the_digits() -> None:
    assert significant(0.0999, 2) == "0.10"
    assert significant(9.99, 2) == "10"


def test_chosen_values_keep_no_idle_digits() -> None:
    assert (exact(1.0, "s"), exact(0.3, "s"), exact(2.5e-4, "s")) == ("1 s", "300 ms", "250 µs")


def test_shares() -> None:
    assert (percent(0.324), percent(0.001), percent(-0.012), percent(0.0)) == ("32 %", "<1 %", "−1 %", "0 %")


def test_compound_units_have_no_prefix() -> None:
    assert scale_for(1e-5, "N s/m").unit == "N s/m"


def test_large_ratios_are_not_spelt_out() -> None:
    assert (times(3.26), times(33.4), times(18614.0), times(float("inf"))) == (
        "3.3 times", "33 times", "over 1000 times", "over 1000 times",
    )  # fmt: skip


def test_exponents_are_raised() -> None:
    assert text(969.0, "N s2/m2", 3) == "969 N s²/m²"
