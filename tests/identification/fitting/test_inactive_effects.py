"""A limit is fitted even where the fit begins out of the data's reach."""

from __future__ import annotations

import pytest

from onlinebayes.criticism.searching.stage import refit
from onlinebayes.identification.data.noise import noise_floors
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.numerics import settle
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorSaturation
from tests.criticism.rigs import measure, model

SATURATION = ActuatorSaturation("motor", Parameter(0.1, 30.0, "N"))  # the commands stay below 12


def test_a_limit_added_by_hand_is_found_from_out_of_reach() -> None:
    measurement = measure({SATURATION: (4.0,)}, runs=3)
    fitted = settle(model().with_effect(SATURATION), measurement, 1.0, noise_floors(measurement.signals, ())).fitted
    assert float(fitted.theta[2]) == pytest.approx(4.0, rel=0.01)


def test_a_refit_whose_linear_estimate_limits_nothing_finds_the_limit() -> None:
    windows = make_windows(model(), measure({SATURATION: (4.0,)}, runs=3), 1.0)
    current = fit(model(), windows, model().nominal)
    found, _ = refit(current, windows, SATURATION, {"limit": 29.0})
    assert float(found.theta[2]) == pytest.approx(4.0, rel=0.01)
