"""Problem file (TOML) -> built objects: simulator, measurement, and how to judge.

    load_problem(path) = Problem(simulator with priors and added effects, measurement, holdout, candidates, selection)

Everything is checked here, before any long work; each error names the file, the key's path, and the cure.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Literal

from onlinebayes.cli.effects import add_effects, check_candidates, import_modules
from onlinebayes.cli.model import build_simulator, known_addresses, signal_units
from onlinebayes.cli.section import Section
from onlinebayes.criticism import Selection
from onlinebayes.criticism.split import split
from onlinebayes.measurements import Measurement, Signal, SignalColumn, TableReader
from onlinebayes.measurements.units import to_si
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator

TOP = ("schema", "model", "measurements", "holdout", "ignore", "parameters", "signals", "selection", "effects", "next")


@dataclass(frozen=True)
class Problem:
    """What a problem file asks.

    Args:
        path: the file.
        simulator: with the priors of ``[parameters]`` and the effects of ``add``.
        measurement: all runs.
        holdout: names of the runs that are kept for the reported error; None for the default.
        candidates: effects to try.
        selection: how they are judged.
        added: keys of the effects that are already part of the model.
    """

    path: Path
    simulator: Simulator
    measurement: Measurement
    holdout: tuple[str, ...] | None
    candidates: Literal["all"] | tuple[str, ...]
    selection: Selection
    added: tuple[str, ...]


def load_problem(
    path: str | Path, add: Sequence[str] = (), note: Callable[[str], None] = lambda _line: None
) -> Problem:
    """Read, check and build a problem.

    Args:
        path: the TOML file; paths in it are relative to its folder.
        add: effects ``name@target`` to add besides the file's own.
        note: told in one line what was left out of the tables.

    Raises:
        BadInput: anything in the file, the model or the tables that cannot be used.
    """
    path = Path(path)
    top = Section(read_toml(path), str(path), known=TOP, later=("runs", "actuators", "model_edit"))
    if (schema := top.whole("schema", 1)) != 1:
        raise top.error("schema", f"version {schema} is unknown", "this version reads schema = 1")
    selection = _selection(top.section("selection", ("folds", "horizon_s", "alpha", "tolerance")))
    effects = top.section("effects", ("candidates", "add", "modules"), later=("scope",))
    tables = top.texts("measurements")
    model, effect_bounds = _parameters(top)
    import_modules(effects, path.parent)
    simulator = build_simulator(top, path.parent, model)
    measurement = _read_tables(top, tables, simulator, note)
    candidates = check_candidates(effects, simulator)
    holdout = _holdout(top, measurement)
    _check_clock(measurement, selection, path)
    if 10 * simulator.timestep > selection.horizon_s:
        problem = f"a timestep of {simulator.timestep:g} s is too long for windows of {selection.horizon_s:g} s"
        raise top.error("model", problem, "give the model a timestep of a tenth of that or less")
    fit, held_out = split(measurement, holdout)
    for part, what in ((fit, "fit"), (held_out, "held-out")):
        _check_measured(part, what, path)
    simulator, added = add_effects(effects, add, simulator, fit, effect_bounds, selection.horizon_s)
    return Problem(path, simulator, measurement, holdout, candidates, selection, added)


def read_toml(path: Path) -> dict[str, Any]:
    """The parsed file; raises :class:`BadInput` with the line where it is missing, not UTF-8 or not TOML."""
    try:
        raw = path.read_bytes()
    except FileNotFoundError:
        raise BadInput("no such file", "name the problem file", where=str(path)) from None
    except IsADirectoryError:
        raise BadInput("is a folder", "name the problem file in it", where=str(path)) from None
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", "check its permissions", where=str(path)) from None
    try:
        return tomllib.loads(raw.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise BadInput("the file is not UTF-8", "save it as UTF-8", where=f"{path}, line {line}") from None
    except (ValueError, RecursionError) as error:  # RecursionError: arrays nested a thousand deep
        raise BadInput(f"is not TOML: {error}", "mend that line", where=str(path)) from None


def _selection(section: Section) -> Selection:
    given: dict[str, Any] = {key: section.number(key) for key in ("horizon_s", "alpha", "tolerance") if key in section}
    if (folds := section.whole("folds")) is not None:
        given["folds"] = folds
    for key, value in given.items():
        low, high = {"alpha": (0, 1), "folds": (1, float("inf"))}.get(key, (0, float("inf")))
        if not low < value < high:
            rule = f"between {low} and {high}" if high < float("inf") else f"above {low}"
            raise section.error(key, f"{value} is out of range", f"give a number {rule}")
    return Selection(**given)


def _parameters(top: Section) -> tuple[ParameterSpace, dict[str, Parameter]]:
    """The model's free parameters, and the bounds given for parameters of added effects (addresses with an @)."""
    section = top.section("parameters")
    if not section.values:
        raise BadInput("[parameters] is missing or empty", "name what may be inferred, with bounds", where=top.file)
    found = {key: _parameter(section, key, value) for key, value in section.values.items()}
    model = {key: parameter for key, parameter in found.items() if "@" not in key}
    return ParameterSpace(model), {key: parameter for key, parameter in found.items() if "@" in key}


def _parameter(section: Section, key: str, value: Any) -> Parameter:
    if any(mark in key for mark in "*?"):
        raise section.error(key, "shared parameters (globs) are not supported by this version", "name each one")
    if isinstance(value, list):
        value = dict(zip(("low", "high"), value, strict=True)) if len(value) == 2 else value
    quoted = key.count(".") >= 2 or "@" in key
    if isinstance(value, dict) and not quoted and any(isinstance(part, dict | list) for part in value.values()):
        raise section.error(key, "an address that is not in quotes", f'write "{_flat(key, value)}" = [low, high]')
    if not isinstance(value, dict):
        raise section.error(key, f"{value!r} is no pair of bounds", "write [low, high] in SI units")
    table = Section(value, section.file, section.full(key), ("low", "high", "scale", "tie", "scope"))
    if table.values.get("tie", False) is not False:
        raise table.error("tie", "shared parameters are not supported by this version", "leave it out")
    if table.text("scope", "shared") != "shared":
        raise table.error("scope", "only 'shared' is supported by this version", "leave it out")
    low, high = (table.number(name) for name in ("low", "high"))
    if low is None or high is None:
        raise section.error(key, "a bound is missing", "write [low, high] or { low = .., high = .. } in SI units")
    with section.at(key):
        return Parameter(low, high, scale=table.text("scale", "linear"))


def _flat(key: str, value: Any) -> str:
    """The address that ``a.b.c = ..`` without quotes meant, which TOML reads as tables within tables."""
    while isinstance(value, dict) and value and not {"low", "high"} & value.keys():
        inner, value = next(iter(value.items()))
        key = f"{key}.{inner}"
    return key


def _read_tables(top: Section, tables: Sequence[str], simulator: Simulator, note: Callable[[str], None]) -> Measurement:
    if not tables:
        raise top.error("measurements", "no table is named", 'write e.g. ["log.csv"]')
    units = signal_units(simulator)
    reader = TableReader(
        signals=[Signal(name, units.get(name, "")) for name in simulator.signals],
        commands=simulator.commands,
        mapped=_signals(top.section("signals", known=None), simulator, units),
        ignore=top.texts("ignore", ()),
        known=known_addresses(simulator),
        note=note,
    )
    return reader.read(Path(top.file).parent / table for table in tables)


def _signals(section: Section, simulator: Simulator, units: dict[str, str]) -> list[SignalColumn]:
    Section(section.values, section.file, section.path, known=simulator.signals)
    mapped = []
    for name in section.values:
        table = section.section(
            name, ("column", "unit", "sign", "scale", "offset", "sd", "resolution"), later=("latency",)
        )
        sign = table.number("sign", 1.0)
        if sign not in (1.0, -1.0):
            raise table.error("sign", f"{sign} is no sign", "write 1 or -1")
        factor = 1.0
        if "unit" in table:
            with table.at("unit"):
                factor = to_si(table.text("unit"), units.get(name, ""))
        scale = table.number("scale", 1.0) or 0.0
        if scale == 0.0:
            raise table.error("scale", "0 would erase the signal", "give what multiplies the column")
        with section.at(name):
            signal = Signal(name, units.get(name, ""), table.number("sd"), table.number("resolution"))
        mapped.append(
            SignalColumn(signal, table.text("column", ""), sign * scale * factor, table.number("offset", 0.0) or 0.0)
        )
    return mapped


def _holdout(top: Section, measurement: Measurement) -> tuple[str, ...] | None:
    if "holdout" not in top:
        return None
    patterns = top.texts("holdout")
    if not patterns:
        raise top.error("holdout", "no run is named", "name runs, or leave it out for the last third")
    for pattern in patterns:
        if not any(fnmatchcase(run, pattern) for run in measurement.runs):
            known = ", ".join(measurement.runs[:12]) + (", ..." if len(measurement.runs) > 12 else "")
            raise top.error("holdout", f"no run is called '{pattern}'", f"the tables have {known}")
    held = tuple(run for run in measurement.runs if any(fnmatchcase(run, pattern) for pattern in patterns))
    if len(held) == len(measurement.runs):
        raise top.error("holdout", "every run is held out", "leave at least one run to fit")
    return held


def _check_measured(measurement: Measurement, what: str, path: Path) -> None:
    if not bool(measurement.data["measured"].any()):
        names = ", ".join(signal.name for signal in measurement.signals)
        raise BadInput(
            f"the {what} runs ({', '.join(measurement.runs[:6])}) have no measured value of {names}",
            "every cell is empty or nan: fill the columns, or choose other runs under 'holdout'",
            where=str(path),
        )


def _check_clock(measurement: Measurement, selection: Selection, path: Path) -> None:
    """A clock in milliseconds that was taken for seconds leaves windows without rows: say so."""
    times = measurement.data["time"]
    for run, time, rows in zip(measurement.runs, times, measurement.lengths.tolist(), strict=True):
        step = float(time[:rows].diff().median())
        if 4 * step > selection.horizon_s:
            raise BadInput(
                f"run '{run}' has a row every {step:g} s, a window of {selection.horizon_s:g} s has too few of them",
                "'time' is in seconds: convert it, or set selection.horizon_s to suit a slow log",
                where=str(path),
            )
