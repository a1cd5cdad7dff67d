"""``measurements`` of a problem file -> the tables, read as ``[time]``, ``[signals]`` and ``[commands]`` say."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from onlinebayes.measurements import Measurement, Signal, SignalColumn, TableReader
from onlinebayes.measurements.formats import open_source
from onlinebayes.measurements.matching import matches
from onlinebayes.problems.mapping import command_columns, is_glob, signal_columns, table_clocks, time_column
from onlinebayes.problems.model import known_addresses, signal_units
from onlinebayes.problems.section import Section
from onlinebayes.simulators.abilities import Extensible

DATA = "$ONLINEBAYES_DATA"
"""As the first part of a table's path: the folder that this variable of the environment names; no other is read."""


def columns_of(top: Section, tables: Sequence[str]) -> set[str]:
    """Names of columns, of mapped signals and of mapped commands that are not ignored."""
    ignored = top.texts("ignore", ())
    found = {name for table in tables for name in open_source(located(top, table)).names}
    kept = {name for name in found if not matches(name, ignored)}
    mapped = {name for kind in ("signals", "commands") for name in top.section(kind).values if not is_glob(name)}
    return kept | mapped


def read_tables(
    top: Section, tables: Sequence[str], columns: Collection[str], simulator: Extensible, note: Callable[[str], None]
) -> Measurement:
    """The tables as one measurement.

    Args:
        top: the whole file.
        tables: as ``measurements`` names them.
        columns: see :func:`columns_of`.
        simulator: gives signals and commands.
        note: told in one line what was left out, or taken for granted.

    Raises:
        BadInput: no table, one that cannot be read, or a key that says something impossible.
    """
    if not tables:
        raise top.error("measurements", "no table is named", 'write e.g. ["log.csv"]')
    units = signal_units(simulator)
    reader = TableReader(
        signals=[Signal(name, units.get(name, "")) for name in simulator.signals],
        commands=simulator.commands,
        mapped=signal_columns(top.section("signals"), simulator.signals, units, columns),
        commanded=command_columns(top.section("commands"), simulator.commands),
        clock=time_column(top.section("time")),
        clocks={located(top, table): clock for table, clock in table_clocks(top.section("time"), tables).items()},
        ignore=top.texts("ignore", ()),
        known=known_addresses(simulator),
        note=note,
    )
    measurement = reader.read(located(top, table) for table in tables)
    for column in reader.mapped:
        _check_latency(top, column, measurement)
    return measurement


def _check_latency(top: Section, column: SignalColumn, measurement: Measurement) -> None:
    """A latency that is longer than every run leaves nothing of its signal."""
    names, latency = [signal.name for signal in measurement.signals], column.latency
    if latency and column.signal.name in names:
        seen = measurement.data["measured"][..., names.index(column.signal.name)]
        if not bool(seen.any()):
            table = top.section("signals").section(column.signal.name)
            raise table.error("latency", f"with {latency:g} s no row of any run is left", "give it in seconds")


def located(top: Section, table: str) -> Path:
    """Locate a table: from the problem file's folder on, or in the folder of measured data."""
    variable, _, rest = table.partition("/")
    if variable != DATA or not rest:
        return Path(top.file).parent / table
    if not (data := os.environ.get(DATA[1:])):
        raise top.error("measurements", f"{DATA[1:]} is not set", f"set it to the folder that holds '{rest}'")
    return Path(data) / rest
