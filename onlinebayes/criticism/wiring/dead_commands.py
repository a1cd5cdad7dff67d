"""Commands that never change though the model cannot follow the log without: the column holds something else.

    u(t) = c in every row of every run, the actuator on,  and the machine moves by more than the model explains

A free swing has such a column, too; the model follows it, or the actuator is said to be off (``enable`` = 0).
"""

from __future__ import annotations

from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput


def dead_commands(measurement: Measurement) -> dict[str, float]:
    """Each command that never changes while its actuator is on -> its value [command units].

    Args:
        measurement: the runs.
    """
    data = measurement.data
    rows = data["mask"]
    command, on = data["command"][rows], (data["enable"][rows] > 0).any(0)
    return {
        name: float(command[0, u])
        for u, name in enumerate(measurement.commands)
        if bool(on[u]) and bool((command[:, u] == command[0, u]).all())
    }


def accused(dead: dict[str, float], moving: tuple[str, ...]) -> str:
    """Which commands never change while what moves, and the cure, in a sentence.

    Args:
        dead: of :func:`dead_commands`.
        moving: names of the signals that the model does not follow.
    """
    return f"{_problem(dead, moving)}: {_cure(dead)}"


def check_driven(measurement: Measurement, moving: tuple[str, ...]) -> None:
    """Refuse runs of which no command ever changes; arguments as of the others.

    Raises:
        BadInput: all commands are dead.
    """
    dead = dead_commands(measurement)
    if dead and len(dead) == len(measurement.commands):
        raise BadInput(_problem(dead, moving), _cure(dead))


def _problem(dead: dict[str, float], moving: tuple[str, ...]) -> str:
    held = " and ".join(f"ctrl.{name} is {value:g}" for name, value in dead.items())
    moves = "moves" if len(moving) == 1 else "move"
    return f"{held} in every row while {' and '.join(moving)} {moves} as the model cannot follow"


def _cure(dead: dict[str, float]) -> str:
    name = next(iter(dead))
    where = f'column = ".." under [commands.{name}]'
    return f"name the column that holds the command ({where}), or, where the actuator was off, write enable.{name} = 0"
