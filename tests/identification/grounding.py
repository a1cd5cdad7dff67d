"""The base model fitted as the tests of identification want it: at the noise of the fit runs."""

from __future__ import annotations

from onlinebayes.identification import measured_floors
from onlinebayes.identification.fitting.window_length import BaseFit, fit_base
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable


def ground(simulator: Identifiable, measurement: Measurement) -> BaseFit:
    """The model fitted to the longest windows that it can follow."""
    return fit_base(simulator, measurement, measured_floors(measurement))
