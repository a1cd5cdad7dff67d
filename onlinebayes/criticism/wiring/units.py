"""The unit of the signals that lets a model follow a log that it cannot follow as it stands.

A log in degrees that is read in radians asks for motions 57 times as large, and the replay diverges: no error is left
that a fault could explain, so that units are tried one after the other until the base model follows the log.
"""

from __future__ import annotations

from collections.abc import Callable

from onlinebayes.criticism.wiring.faults import Rescaled
from onlinebayes.criticism.wiring.possible import possible_faults, units_of_all
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput, Stopped
from onlinebayes.simulators.identifiable import Identifiable


def unit_that_fits(
    simulator: Identifiable, measurement: Measurement, follows: Callable[[Measurement], bool]
) -> Rescaled | None:
    """The first unit with which the model follows the log, those of all joints first; None where none does.

    Args:
        simulator: gives joints and their kinds.
        measurement: the fit runs as they are read.
        follows: whether the base model does, with the runs read so; raises ``BadInput`` where it cannot be fitted.
    """
    measured = {signal.name for signal in measurement.signals}
    every = (fault for fault in possible_faults(simulator, measurement) if isinstance(fault, Rescaled))
    for unit in dict.fromkeys((*units_of_all(simulator, measured), *every)):
        if unit.kind != "signal" or unit.factor < 0:
            continue
        try:
            if follows(unit.correct(measurement)):
                return unit
        except Stopped:
            raise
        except BadInput:
            continue
    return None
