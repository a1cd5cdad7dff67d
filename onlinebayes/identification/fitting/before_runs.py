"""What was commanded before a run's first row, which no log says: what that row commands, or nothing.

    held:  the first row's command had been given for long       (a log cut out of a longer motion, a servo at its goal)
    idle:  none had been given                                    (a machine switched on, a simulator that was reset)

A delay or a lag of an actuator goes on with it for its own length, in the first window of every run. Read the wrong
way that window errs by more than all the others, and a late motor passes for anything.
"""

from __future__ import annotations

from dataclasses import replace

from onlinebayes.identification.fitting.numerics import settled_misfit
from onlinebayes.measurements import Measurement
from onlinebayes.simulators.identifiable import Identifiable


def commanded_at_once(measurement: Measurement) -> bool:
    """Whether the first row of a run commands something: only then do the readings differ."""
    return bool(measurement.data["command"][:, :1].any())


def remembers_commands(simulator: Identifiable) -> bool:
    """Whether an effect of the simulator remembers commands."""
    return any(effect.has_command and effect.memory > 0 for effect in simulator.effects)


def idle_before(simulator: Identifiable, fit_runs: Measurement, horizon: float) -> bool:
    """Whether a base model that remembers commands follows the log better without any before a run.

    Args:
        simulator: the base model.
        fit_runs: the runs that it is fitted to.
        horizon: H [s].
    """
    if not (remembers_commands(simulator) and commanded_at_once(fit_runs)):
        return False
    held, idle = (settled_misfit(simulator, replace(fit_runs, idle_before=one), horizon) for one in (False, True))
    return idle < held
