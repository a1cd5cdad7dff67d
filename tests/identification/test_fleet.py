"""Many units of one machine: the textbook's formulas where there are some, and intervals that hold what they say."""

from __future__ import annotations

import math

import pytest
import torch
from scipy.stats import t as student

from onlinebayes.identification import Fleet, fleet_of

VALUES = (9.1, 10.4, 11.9, 8.7, 10.2)


def fleet(values: tuple[float, ...], errors: tuple[float, ...] | float, common: float = 0.0) -> Fleet:
    """Units with independent errors, and one that all have in common (sds)."""
    y = torch.tensor(values, dtype=torch.float64)
    own = torch.as_tensor(errors, dtype=torch.float64).expand(len(y))
    return fleet_of([f"u{k}" for k in range(len(y))], y, torch.diag(own.square()) + common**2, "kg")


def test_equal_errors_are_the_textbooks_formula() -> None:
    """mu: the mean; tau^2 = S^2 - s^2, S the units' sample sd."""
    found, s = fleet(VALUES, 0.5), 0.5
    sample = float(torch.tensor(VALUES, dtype=torch.float64).std())
    assert found.mean.mean == pytest.approx(sum(VALUES) / 5)
    assert found.spread.mean == pytest.approx(math.sqrt(sample**2 - s**2), rel=1e-5)
    # Each unit keeps of its distance from the mean the share that the spread has in what is seen.
    kept = [(found.units[f"u{k}"].mean - found.mean.mean) / (VALUES[k] - found.mean.mean) for k in range(5)]
    assert kept == pytest.approx([kept[0]] * 5, rel=1e-9)
    assert 0.7 < kept[0] < 1
    assert sum(unit.sd for unit in found.units.values()) < 5 * s


@pytest.mark.parametrize("count", [3, 5, 10, 40])
def test_units_known_exactly_are_students_t(count: int) -> None:
    values = tuple((10 + 2 * torch.randn(count, generator=torch.Generator().manual_seed(count)).double()).tolist())
    found, sample = fleet(values, 1e-4), torch.tensor(values, dtype=torch.float64)
    mean, sd, reach = float(sample.mean()), float(sample.std()), float(student.ppf(0.95, count - 1))
    assert found.spread.mean == pytest.approx(sd, rel=1e-5)
    assert found.next.q95 == pytest.approx(mean + reach * sd * math.sqrt(1 + 1 / count), rel=1e-5)
    assert found.next.q05 == pytest.approx(mean - reach * sd * math.sqrt(1 + 1 / count), rel=1e-5, abs=1e-5)
    assert found.mean.q95 == pytest.approx(mean + reach * sd / math.sqrt(count), rel=1e-5)


def test_two_units_say_little_of_a_third() -> None:
    found = fleet((1.0, 1.1), 1e-4)
    # t with one degree of freedom; the grid ends at ten thousand times the difference.
    assert found.next.q95 == pytest.approx(1.05 + 6.3138 * 0.1 / math.sqrt(2) * math.sqrt(1.5), rel=2e-3)


def test_the_spread_is_where_the_restricted_likelihood_is_largest() -> None:
    """Errors that differ: no formula, but the score of the restricted likelihood is zero there."""
    errors = (0.2, 0.9, 0.4, 1.2, 0.6)
    tau = fleet(VALUES, errors).spread.mean
    assert tau > 0

    def log_likelihood(tau: float) -> float:
        weight = torch.tensor([1 / (s**2 + tau**2) for s in errors], dtype=torch.float64)
        y = torch.tensor(VALUES, dtype=torch.float64)
        mean = (weight @ y) / weight.sum()
        return float(0.5 * weight.log().sum() - 0.5 * weight.sum().log() - 0.5 * weight @ (y - mean).square())

    assert log_likelihood(tau) > max(log_likelihood(tau * k) for k in (0.0, 0.99, 1.01, 3.0))


def test_units_that_are_alike_have_no_spread_and_still_room() -> None:
    found = fleet((1.0, 1.1, 0.95, 1.02, 0.93), 0.1)
    assert (found.spread.mean, found.spread.q05) == (0.0, 0.0)
    assert 0.05 < found.spread.q95 < 0.4  # five units with such errors do not exclude that much
    assert 0.05 < found.next.q95 - found.mean.mean < 0.5


def test_what_all_units_share_is_no_likeness() -> None:
    """A common error moves all alike: it is in the mean's error and hides no spread."""
    alone, shared = fleet(VALUES, 0.3), fleet(VALUES, 0.3, common=2.0)
    assert shared.spread.mean == pytest.approx(alone.spread.mean, rel=1e-6)
    assert shared.mean.sd > 2.0 > alone.mean.sd
    assert fleet(VALUES, math.hypot(0.3, 2.0)).spread.mean == 0.0  # the same error, were each unit's its own


def test_a_unit_that_is_badly_known_borrows_from_the_others() -> None:
    found = fleet((1.0, 1.2, 0.8, 1.1, 3.0), (0.01, 0.01, 0.01, 0.01, 5.0))
    assert found.units["u4"].mean == pytest.approx(1.03, abs=0.02)
    assert found.units["u4"].sd < 0.5
    assert found.units["u1"].mean == pytest.approx(1.2, abs=0.01)


def test_the_components_are_the_next_unit() -> None:
    for count in (2, 3, 8):
        found = fleet((VALUES + VALUES)[:count], 0.3)
        weight, mean, sd = torch.tensor(found.components, dtype=torch.float64).T
        assert float(weight.sum()) == pytest.approx(1.0)
        for end, level in ((found.next.q05, 0.05), (found.next.q95, 0.95)):
            assert float(weight @ torch.special.ndtr((end - mean) / sd)) == pytest.approx(level, abs=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("units", "ratio"), [(5, 1.0), (3, 0.3), (8, 3.0)])
def test_the_next_unit_lies_within_its_interval(units: int, ratio: float) -> None:
    """400 fleets, spread / error = ratio. A right interval fails one of the three tests with p < .005.

    360 +- 6 of 400 hold the unit; below 343 lies 2.9 sds. Where the spread is no larger than the errors the interval
    may be too wide, so that only the last has an upper limit (377).
    """
    draw, held = torch.Generator().manual_seed(units), 0
    for _ in range(400):
        theta = 5 + ratio * torch.randn(units + 1, generator=draw, dtype=torch.float64)
        error = 0.7 + 0.6 * torch.rand(units, generator=draw, dtype=torch.float64)
        y = theta[:units] + error * torch.randn(units, generator=draw, dtype=torch.float64)
        following = fleet_of([str(k) for k in range(units)], y, torch.diag(error.square())).next
        held += following.q05 < float(theta[-1]) < following.q95
    assert held >= 343
    assert held <= 377 or ratio < 3


@pytest.mark.parametrize(("values", "errors"), [((1.0,), 0.1), ((1.0, 2.0), 0.0), ((1.0, 2.0), math.inf)])
def test_a_fleet_has_two_units_each_with_an_error(values: tuple[float, ...], errors: float) -> None:
    with pytest.raises(ValueError, match="two are needed, each with an error"):
        fleet(values, errors)
