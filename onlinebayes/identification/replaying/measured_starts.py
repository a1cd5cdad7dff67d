"""Windows whose starts are replayed as measured, also where a sensor is late.

    shown at t_w:  q(t_w - T), v(t_w - T)        the state at t_w:  what the sensor shows at t_w + T

A start is handed over as the sensor shows it, and the state behind it is (q + v T, v), see ``simulators.sensing``. In
a fit, where starts are free, that is enough; replayed as measured, a late sensor's velocity would be wrong by a T. Of a
sensor whose clock drifts, T is what it lags at t_w, and it shows v (1 - rate).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from jaxtyping import Float
from torch import Tensor

from onlinebayes.identification.data.grid import row_step, run_grids
from onlinebayes.identification.data.latency import Lag, without_latency
from onlinebayes.identification.data.starts import window_starts
from onlinebayes.identification.data.windows import MEMORY, Windows, joint_names, make_windows
from onlinebayes.identification.replaying.timed import instants
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.abilities import Measured
from onlinebayes.simulators.effects import ActuatorDelay, SensorClock, SensorDelay
from onlinebayes.simulators.identifiable import Identifiable


def windows_to_replay(
    simulator: Identifiable,
    measurement: Measurement,
    theta: Float[Tensor, " P"],
    horizon: float,
    noise: Float[Tensor, " S"],
) -> Windows:
    """Windows for a replay from starts as measured, at every row of the simulator.

    Args:
        simulator: what will replay them.
        measurement: the runs.
        theta: its parameters, for the delays of its sensors [SI].
        horizon: H [s].
        noise: floor of each signal [SI].
    """
    windows = make_windows(simulator, measurement, horizon, MEMORY * horizon, noise, inset=True)
    joints = joint_names(simulator)
    late = dict[str, Lag]()
    for signal, lag in _lags(simulator, theta):
        if signal.removeprefix("qpos.") in simulator.joint_kinds and signal.removeprefix("qpos.") in joints:
            late[signal] = late[signal].plus(lag) if signal in late else lag
    if not late:
        return windows
    prompt = without_latency(measurement, late)
    cuts = [
        (r, g * windows.step, (g + windows.rows) * windows.step)
        for r, g in zip(windows.run.tolist(), windows.first.tolist(), strict=True)
    ]
    names = [signal.name for signal in measurement.signals]
    state, _, moving = window_starts(run_grids(prompt, row_step(prompt)), cuts, names, joints, noise)
    start, begin = windows.start.clone(), instants(windows)[0].to(windows.start)
    for signal, lag in late.items():
        j = joints.index(signal.removeprefix("qpos."))
        v = state[:, len(joints) + j]
        known = windows.free[:, j] & moving[:, j] & ~windows.start_given[:, j]  # what is known is no reading
        start[known, j] = (state[:, j] - (lag.at_zero + lag.rate * begin) * v)[known]
        start[known, len(joints) + j] = (v * (1 - lag.rate))[known]
    return replace(windows, start=start)


def _lags(simulator: Measured, theta: Float[Tensor, " P"]) -> Iterator[tuple[str, Lag]]:
    """Signals that are shown late, and by how much, where that is one law for all runs."""
    yield from ((signal, Lag(delay)) for signal, delay in delays(simulator, theta, SensorDelay).items() if delay)
    names = simulator.parameters
    for effect in simulator.effects:
        if isinstance(effect, SensorClock) and all(f"{effect.key}.{name}" in names for name in effect.parameters):
            rate, offset = (float(theta[names.index(f"{effect.key}.{name}")]) for name in ("rate", "offset"))
            if rate or offset:
                yield effect.target, Lag(offset - rate * effect.begin, rate)


def delays(
    simulator: Measured, theta: Float[Tensor, " P"], kind: type[SensorDelay] | type[ActuatorDelay]
) -> dict[str, float]:
    """Target -> by how much the simulator shows or drives it late [s], where that is one value for all runs."""
    names = simulator.parameters
    return {
        effect.target: float(theta[names.index(f"{effect.key}.delay")])
        for effect in simulator.effects
        if isinstance(effect, kind) and f"{effect.key}.delay" in names
    }
