"""A limit is fitted even where the fit begins out of the data's reach."""

from __future__ import annotations

import pytest

from onlinebayes.identification.data.noise import noise_floors
from onlinebayes.identification.fitting.numerics import settle
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorSaturation
from tests.criticism.rigs import measure, model

SATURATION = ActuatorSaturation("motor", Parameter(0.1, 30.0, "N"))  # the commands stay below 12


def test_a_limit_added_by_hand_is_found_from_out_of_reach() -> None:
    measurement = measure({SATURATION: (4.0,)}, runs=3)
    fitted = settle(model().with_effect(SATURATION), measurement, 1.0, noise_floors(measurement.signals, ())).fitted
    assert float(fitted.theta[2]) == pytest.approx(4.0, rel=0.01)
