"""The model's time step fitted to the log's clock: rows fall on steps, and a command changes between two of them.

    h' = row / n,   n the least whole number >= row / h with an h' that a file can hold;      h' = n row where h > row

With rows every 5 ms and a step of 2 ms no row after the first falls on a step of the right command: averaged over 4 ms,
held commands arrive half a millisecond early and late in turn.
"""

from __future__ import annotations

import math
from typing import TypeVar

from onlinebayes.identification.data.grid import row_step
from onlinebayes.identification.replaying.integration import adjustable
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.abilities import Integrated

S = TypeVar("S", bound=Integrated)

OFF = 0.1  # steps by which a row may miss a whole number of them: the median of a jittering clock is no better known


def in_step(simulator: S, measurement: Measurement) -> S:
    """The simulator with the next shorter step that divides the rows; itself where it does, or has a fixed step.

    Args:
        simulator: the base model.
        measurement: the fit runs.
    """
    row, own = float(f"{row_step(measurement):.9g}"), simulator.timestep
    ratio = row / own if own <= row else own / row
    if not adjustable(simulator) or abs(ratio - round(ratio)) <= OFF:
        return simulator
    return simulator.with_timestep(row * math.floor(ratio) if own > row else row / _parts(row, math.ceil(ratio)))


def restepped(given: Integrated, used: Integrated, measurement: Measurement) -> tuple[str, ...]:
    """Return a note for a user whose model is integrated with another step than its own; nothing where it is not.

    Args:
        given, used: the base model before and after :func:`in_step`.
        measurement: the fit runs.
    """
    if used.timestep == given.timestep:
        return ()
    row, own, step = row_step(measurement), given.timestep, used.timestep
    if own > row:
        why = f"the model's timestep of {own:g} s is no multiple of that"
    else:
        why = f"that is no multiple of the model's timestep of {own:g} s"
    used_so = f"{step:g} s, {round(row / step)} to a row" if step < row else f"{step:g} s"
    return (f"the log has a row every {row:.4g} s: {why}, so the model is run in steps of {used_so}",)


def _parts(row: float, fewest: int) -> int:
    """Into how many steps a row is cut: the fewest that give a step of few digits, which model files keep exactly."""
    plain = (n for n in range(fewest, 2 * fewest) if math.isclose(row / n, float(f"{row / n:.5g}"), rel_tol=1e-9))
    return next(plain, fewest)
