"""How wrong the model is before anything is fitted: the first answer, within seconds.

    r_s = RMS over all windows of y_s - y_s(nominal theta, smoothed start)        [SI, and over the sensor noise]

The starts are not fitted yet, so that r may be larger than what the fitted model leaves even where the model is right.
The model runs at its own step. Only where that would take long it takes a longer one, and that is said: its error of
integration is in r, too.
"""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification import quantities
from onlinebayes.identification.data.grid import row_step
from onlinebayes.identification.data.noise import measured_floors
from onlinebayes.identification.data.windows import MEMORY, Windows, make_windows
from onlinebayes.identification.replaying.ladder import ladder
from onlinebayes.identification.replaying.replay import history_rows, replay
from onlinebayes.identification.results import Selection
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable

MOST_STEPS = 500_000
"""The first answer takes no more steps of integration: some seconds of them."""


def first_answer(simulator: Identifiable, measurement: Measurement, selection: Selection) -> str:
    """One sentence; nothing where nothing moves.

    Args:
        simulator: the model as it was given.
        measurement: the fit runs.
        selection: for the horizon.

    Raises:
        BadInput: the measurement does not suit the simulator.
    """
    noise = measured_floors(measurement)
    model, windows = _affordable(simulator, measurement, selection.horizon_s, noise)
    nominal = model.parameters.clamp(model.nominal.to(noise))
    signals, valid = replay(model, windows, nominal[None], windows.start[None])
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
    longer = model.timestep > simulator.timestep
    step = f", integrated in steps of {quantities.exact(model.timestep, 's')}" if longer else ""
    return f"{given}{step}, the model errs by {size} in {name}, {over} the sensor noise."


def _affordable(
    simulator: Identifiable, measurement: Measurement, horizon: float, noise: Float[Tensor, " S"]
) -> tuple[Identifiable, Windows]:
    """The model by its own method at its own step, or at the shortest longer one that does not take long."""
    own = (rung for rung in ladder(simulator, horizon, row_step(measurement)) if rung.method == "own")
    steps = sorted({rung.timestep for rung in own if rung.timestep >= simulator.timestep})
    for step in steps:
        model = simulator if step == simulator.timestep else simulator.with_timestep(step)
        windows = make_windows(model, measurement, horizon, MEMORY * horizon, noise)
        rows = windows.count * (windows.rows + history_rows(model, windows))
        if rows * windows.step / step <= MOST_STEPS:
            break
    return model, windows
