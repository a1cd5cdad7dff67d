"""How wrong the model is before anything is fitted: the first answer, within seconds.

    r_s = RMS over all windows of y_s - y_s(nominal theta, smoothed start)        [SI, and over the sensor noise]

The starts are not fitted yet, so that r may be larger than what the fitted model leaves even where the model is right.
"""

from __future__ import annotations

from onlinebayes.criticism import quantities
from onlinebayes.criticism.data.grid import row_step
from onlinebayes.criticism.data.noise import measured_floors
from onlinebayes.criticism.data.windows import MEMORY, make_windows
from onlinebayes.criticism.replaying.ladder import ladder
from onlinebayes.criticism.replaying.replay import replay
from onlinebayes.criticism.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.base import Simulator


def as_given(simulator: Simulator, measurement: Measurement, selection: Selection) -> str:
    """One sentence; nothing where nothing moves.

    Args:
        simulator: the model as it was given.
        measurement: the fit runs.
        selection: for the horizon.

    Raises:
        BadInput: the measurement does not suit the simulator.
    """
    noise = measured_floors(measurement)
    coarse = ladder(simulator, selection.horizon_s, row_step(measurement))[0].of(simulator)
    windows = make_windows(coarse, measurement, selection.horizon_s, MEMORY * selection.horizon_s, noise)
    nominal = coarse.parameters.clamp(coarse.nominal.to(noise))
    signals, valid = replay(coarse, windows, nominal[None], windows.start[None])
    if not bool(valid.all()):
        return f"As it was given, the model diverges in {int((~valid).sum())} of {windows.count} windows."
    seen = windows.observed
    if not bool(seen.any()):
        return ""
    rms = ((windows.value - signals[0]).square() * seen).sum((0, 1)).div(seen.sum((0, 1)).clamp_min(1)).sqrt()
    worst = int((rms / noise).argmax())
    name, unit = measurement.signals[worst].name, measurement.signals[worst].unit
    size, over = quantities.text(float(rms[worst]), unit), quantities.times(float(rms[worst] / noise[worst]))
    given = "With nothing fitted and added effects at zero" if simulator.effects else "As it was given"
    return f"{given}, the model errs by {size} in {name}, {over} the sensor noise."
