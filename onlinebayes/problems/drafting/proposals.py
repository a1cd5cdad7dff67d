"""What is proposed for the model's names: by words, by order, by axes, as twins of what was measured, in this order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from onlinebayes.problems.drafting.actuator_inputs import Input, actuator_inputs
from onlinebayes.problems.drafting.matching import Match, match
from onlinebayes.problems.drafting.numbered import by_order
from onlinebayes.problems.drafting.poses import by_axes
from onlinebayes.problems.drafting.twins import twins
from onlinebayes.problems.drafting.words import SWITCHES, words
from onlinebayes.simulators.mujoco import MujocoSimulator


def proposals(names: Sequence[str], columns: Sequence[str], inputs: Mapping[str, Input]) -> tuple[Match, ...]:
    """Columns for as many of the names as can be told, each once.

    Args:
        names: of the model, ``<kind>.<joint or actuator>`` with kind qpos, qvel or ctrl.
        columns: of the log.
        inputs: see :func:`~onlinebayes.problems.drafting.actuator_inputs.actuator_inputs`.
    """
    found = match(names, columns, inputs)
    found += by_order(names, *_left(found, names, columns), inputs)
    found += by_axes(names, *_left(found, names, columns))
    return found + twins(found, *_left(found, names, columns), inputs)


def proposed(simulator: MujocoSimulator, columns: Sequence[str]) -> dict[str, str]:
    """Name of the model -> column of a log, by names alone."""
    names = (*simulator.signals, *(f"ctrl.{name}" for name in simulator.commands))
    return {one.name: one.column for one in proposals(names, columns, actuator_inputs(simulator.model))}


def _left(found: Sequence[Match], names: Sequence[str], columns: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names without a column, and columns that nothing takes."""
    matched, taken = {one.name for one in found}, {one.column for one in found}
    return [name for name in names if name not in matched], [column for column in columns if column not in taken]


def switches(commands: Sequence[str], columns: Sequence[str]) -> tuple[Match, ...]:
    """``enable.<actuator>`` for a column that says so and names the actuator, which the only one need not be."""
    found = []
    for name in commands:
        own = set(words(name))
        said = [
            c
            for c in columns
            if c != f"enable.{name}" and (have := set(words(c))) & SWITCHES and have <= own | SWITCHES
        ]
        named = [column for column in said if own <= set(words(column)) or len(commands) == 1]
        if len(named) == 1 and f"enable.{name}" not in columns:
            found.append(Match(f"enable.{name}", named[0]))
    return tuple(found)
