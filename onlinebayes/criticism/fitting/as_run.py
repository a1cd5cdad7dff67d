"""The model as its user runs it, own step and own integrator, where that follows the log far better than a finer one.

    rms(own) <= 1.2 floors < rms(finer)    or    rms(own) <= 2/3 rms(finer)      ->  own step

Numerics are judged against the motion itself, so that no law is blamed for what the integrator does. But a log may come
from a simulator that integrates as coarsely as the model (a policy's rollouts, a twin), and then the model is right as
it is, and a finer step errs by what the log's step did. Where the model grown so far leaves more than noise at a finer
step or by another method, it is tried as it was given, too.
"""

from __future__ import annotations

from onlinebayes.criticism.data.windows import MEMORY, Windows, make_windows
from onlinebayes.criticism.fitting.fit import Fit, improve, unfitted
from onlinebayes.criticism.fitting.projection import misfit
from onlinebayes.criticism.replaying.ladder import Rung
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

NOISE = 1.2  # floors
FAR_BETTER = 2 / 3


def as_run(
    simulator: Simulator, measurement: Measurement, horizon: float, finer: Fit, windows: Windows, rung: Rung
) -> tuple[Windows, Fit] | None:
    """Windows and fit at the model's own step; None where that is not far better.

    Args:
        simulator: at its own step, with the effects added so far.
        measurement: the fit runs.
        horizon: H [s].
        finer, windows, rung: the same model fitted on the rung that its numerics asked for.
    """
    if not (rung.runge_kutta or rung.timestep < simulator.timestep) or misfit(finer.projected) <= NOISE:
        return None
    try:
        own = make_windows(simulator, measurement, horizon, MEMORY * horizon, windows.noise)
        starts = finer.lin.starts if own.start.shape == finer.lin.starts.shape else None
        begun = unfitted(simulator, own, finer.theta, starts=starts)
    except BadInput:  # its own step does not divide the rows, or diverges
        return None
    if misfit(begun.projected) >= misfit(finer.projected):
        return None
    fitted = improve(begun, own)
    return (own, fitted) if misfit(fitted.projected) <= max(NOISE, FAR_BETTER * misfit(finer.projected)) else None
