"""Rows of ``thesis-4.1`` and ``thesis-5.1`` from the jobs that are there; a job that was not run leaves no row."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal

from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import ResultTable
from recipes.studies.table_online import ROWS
from recipes.studies.table_systems import SYSTEMS
from recipes.studies.tables import NOT_IN_THE_DYNAMICS, UNKNOWABLE
from recipes.studies.thesis import table_4_1, table_5_1
from recipes.studies.thesis.columns import CEILING, FILTER
from recipes.studies.thesis.printed import TABLE_4_1, TABLE_5_1

Part = Literal["4.1", "5.1", "loop"]
Job = tuple[Part, str, float, int]
"""(part, system, noise, seed)."""

NEAR, NOISES = 0.3, (0.0, 0.01)
"""Nats below the ceiling that are allowed."""


def tables(found: Mapping[Job, dict[str, Any]], command: str, seeds: Sequence[int]) -> list[ResultTable]:
    """Both tables; one of which no job is done is left out."""
    first, second = (ResultTable(f"thesis-{number}", command, seeds) for number in ("4.1", "5.1"))
    first.add("jobs done, of both noises", done(found, ("4.1",), len(SYSTEMS) * len(seeds)))
    first.add("protocol", table_4_1.PROTOCOL)
    for name, system in SYSTEMS.items():
        for parameter in system.rows:
            told = name if name.startswith("Acrobot") else f"{name} {parameter}"
            of = {noise: each(found, ("4.1",), name, noise, parameter) for noise in NOISES}
            prior = BoxUniform(ParameterSpace({parameter: system.space[parameter]}))
            add_rows(first, told, of, TABLE_4_1[told], float(prior.log_prob(prior.sample((1,)))))
    second.add("jobs done, of both noises", done(found, ("5.1", "loop"), 2 * len(ROWS) * len(seeds)))
    second.add("protocol", table_5_1.PROTOCOL)
    for name, row in ROWS.items():
        of = {noise: each(found, ("5.1", "loop"), name, noise) for noise in NOISES}
        prior = BoxUniform(row.space)
        add_rows(second, name, of, TABLE_5_1[name], float(prior.log_prob(prior.sample((1,)))))
    return [table for table in (first, second) if len(table.rows) > 2]


def done(found: Iterable[Job], parts: Sequence[str], each_noise: int) -> str:
    """Count the jobs of a table that are done."""
    return f"{sum(job[0] in parts for job in found)} of {len(NOISES) * each_noise}"


def each(
    found: Mapping[Job, dict[str, Any]], parts: Iterable[str], name: str, noise: float, parameter: str | None = None
) -> dict[str, list[float]]:
    """Column -> figures of all seeds."""
    columns: dict[str, list[float]] = {}
    for (part, system, level, _), result in found.items():
        if part in parts and (system, level) == (name, noise):
            for column, value in (result if parameter is None else result[parameter]).items():
                columns.setdefault(column, []).append(value)
    return columns


def add_rows(
    table: ResultTable,
    told: str,
    of: Mapping[float, Mapping[str, Sequence[float]]],
    thesis: Mapping[str, float],
    prior: float,
) -> None:
    """Rows of one system."""
    if not any(of.values()):
        return
    for noise, columns in of.items():
        for column, values in columns.items():
            table.add_seeds(f"{told}, noise {100 * noise:g} %: {column}", values, unit="nats")
        add_goal(table, f"{told}, noise {100 * noise:g} %", told, columns, max(thesis.values()))
    for column, figure in thesis.items():
        table.add(f"{told}, thesis: {column}", figure, unit="nats")
    table.add(f"{told}: the prior", prior, unit="nats")


def add_goal(table: ResultTable, head: str, told: str, columns: Mapping[str, Sequence[float]], thesis: float) -> None:
    """The filter's goal: near the ceiling; without noise, where nothing bounds a density, above the thesis's best."""
    if FILTER not in columns:
        return
    ours = statistics.median(columns[FILTER])
    if told == NOT_IN_THE_DYNAMICS:
        goal, holds = f"0 within {UNKNOWABLE:g}", abs(ours) <= UNKNOWABLE
    elif CEILING in columns:
        most = statistics.median(columns[CEILING])
        goal, holds = f"at most {NEAR:g} below the ceiling", ours >= most - NEAR
    else:
        goal, holds = f"above {thesis:g}, the thesis's best", ours > thesis
    table.add(f"{head}: the filter's median", ours, unit="nats", goal=goal, holds=holds)
