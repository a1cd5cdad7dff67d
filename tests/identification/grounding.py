"""The base model fitted as the tests of identification want it: at the noise of the fit runs, on the whole ladder."""

from __future__ import annotations

from onlinebayes.identification import Grounds, Selection, measured_floors, settle
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable


def ground(simulator: Identifiable, measurement: Measurement, selection: Selection) -> Grounds:
    """The model fitted to windows of the selection's length."""
    return settle(simulator, measurement, selection.horizon_s, measured_floors(measurement))
