"""An effect that is added by hand is fitted even where its neutral value lies out of the data's reach."""

from __future__ import annotations

import pytest

from onlinebayes.criticism.noise import floors
from onlinebayes.criticism.numerics import settle
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.effects import ActuatorSaturation
from tests.criticism.rigs import measure, model


def test_a_limit_added_by_hand_is_found_from_out_of_reach() -> None:
    saturation = ActuatorSaturation("motor", Parameter(0.1, 30.0, "N"))  # the commands stay below 12
    measurement = measure({saturation: (4.0,)}, runs=3)
    fitted = settle(model().with_effect(saturation), measurement, 1.0, floors(measurement.signals, ())).fitted
    assert float(fitted.theta[2]) == pytest.approx(4.0, rel=0.01)
