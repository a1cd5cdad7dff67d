"""Commands row by row: an empty cell holds the last command, and nothing may be held before the first.

u_i = the last command written at or before row i;   enable_i likewise, 1 before the first
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from onlinebayes.runs import BadInput

Column = Float[np.ndarray, " T"]
Rows = Int[np.ndarray, " T"]


def held(name: str, values: Column, where: str, rows: Rows) -> Column:
    """Each empty cell takes the last value before it; those before the first value stay nan (enable: 1).

    Raises:
        BadInput: an ``enable`` that is neither 0 nor 1.
    """
    last = np.maximum.accumulate(np.where(np.isnan(values), -1, np.arange(len(values))))
    start = 1.0 if name.startswith("enable.") else np.nan
    filled = np.where(last >= 0, values[np.maximum(last, 0)], start)
    if name.startswith("enable.") and (wrong := np.flatnonzero(~np.isin(filled, (0.0, 1.0)))).size:
        raise BadInput(
            f"enable is {filled[wrong[0]]:g}",
            "write 1 while the actuator is on, 0 while it is off",
            where=f"{where}, row {rows[wrong[0]]}, column '{name}'",
        )
    return filled


def begun(values: Column) -> Column:
    """A measured input before its first value: that value; 0 throughout where it has none."""
    known = np.flatnonzero(~np.isnan(values))
    first = values[known[0]] if known.size else 0.0
    return np.where(np.isnan(values), first, values)


def blank_while_off(actuator: str, column: str, values: dict[str, np.ndarray], where: str, rows: Rows) -> None:
    """A run's first commands may be empty only while the actuator is off; they become 0, which nothing feels.

    Args:
        actuator: whose command ``values["ctrl.<actuator>"]`` is changed in place.
        column: the table's name of it, for the message.
        values: the run's columns by the model's names.
        where, rows: for the message.

    Raises:
        BadInput: the actuator is on before its first command.
    """
    name = f"ctrl.{actuator}"
    if name not in values:
        return
    blank = _uncommanded(actuator, values)
    if (wrong := np.flatnonzero(blank)).size:
        raise BadInput(
            "no command yet: the cell is empty and there is none before it in the run",
            "give the command that holds in the run's first row",
            where=f"{where}, row {rows[wrong[0]]}, column '{column}'",
        )
    values[name] = np.where(np.isnan(values[name]), 0.0, values[name])


def first_commanded(actuators: Sequence[str], values: Mapping[str, np.ndarray]) -> int:
    """The first row from which every actuator that is on has a command; the number of rows when there is none."""
    rows = len(values["time"])
    missing = np.zeros(rows, dtype=bool)
    for actuator in actuators:
        if f"ctrl.{actuator}" in values:
            missing |= _uncommanded(actuator, values)
    return int(np.flatnonzero(missing)[-1]) + 1 if missing.any() else 0


def _uncommanded(actuator: str, values: Mapping[str, np.ndarray]) -> np.ndarray:
    command = values[f"ctrl.{actuator}"]
    return np.isnan(command) & (values.get(f"enable.{actuator}", np.ones(len(command))) != 0)
