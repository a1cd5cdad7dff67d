"""Problem file (TOML) -> built objects: simulator, measurement, and how to judge.

    load_problem(path) = ProblemFile(simulator with priors and effects, measurement, holdout, candidates, selection)

Everything is checked here, before any long work; each error names the file, the key's path, and the cure.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

from onlinebayes.criticism import Allowed, Scope, Selection
from onlinebayes.identification import completed, split, start_coordinates
from onlinebayes.measurements import BetweenRows, Measurement
from onlinebayes.measurements.matching import matches
from onlinebayes.problems.effects import add_effects, check_candidates, check_constant, check_effect, import_modules
from onlinebayes.problems.limits import read_allowed
from onlinebayes.problems.model import beside_bounds, build_simulator
from onlinebayes.problems.parameters import Declared, declared
from onlinebayes.problems.section import Section
from onlinebayes.problems.starts import known_starts
from onlinebayes.problems.tables import columns_of, located, read_tables
from onlinebayes.runs import BadInput
from onlinebayes.simulators.abilities import Extensible
from onlinebayes.simulators.identifiable import Identifiable

LARGEST, MOST_DOTS = 2**20, 2000
"""Bytes of a problem file, and dots in one of its lines."""

FEWEST_STEPS = 4
"""Of the model in a run: one of fewer has a clock in another unit."""

TOP = (
    *("schema", "model", "measurements", "exclude", "holdout", "ignore", "skip_s", "groups", "units", "starts"),
    *(
        "parameters",
        "time",
        "signals",
        "commands",
        "commands_between_rows",
        "runs",
        "actuators",
        "model_edit",
        "selection",
    ),
    *("effects", "next"),
)


@dataclass(frozen=True)
class ProblemFile:
    """Contents of a problem file, read and checked.

    Args:
        path: the file.
        simulator: with the priors of ``[parameters]`` and the effects of ``add``.
        measurement: all runs.
        holdout: names of the runs that are kept for the reported error; None for the default.
        candidates: effects to try.
        selection: how they are judged.
        added: keys of the effects that are already part of the model.
        scope: which parameters differ between runs; None for none.
        inputs: file -> what it is to the problem, e.g. ``"the model"``.
    """

    path: Path
    simulator: Identifiable
    measurement: Measurement
    holdout: tuple[str, ...] | None
    candidates: Literal["all"] | tuple[str, ...]
    selection: Selection
    added: tuple[str, ...]
    scope: Scope | None = None
    inputs: Mapping[Path, str] = field(default_factory=dict)


def load_problem(
    path: str | Path, add: Sequence[str] = (), note: Callable[[str], None] = lambda _line: None
) -> ProblemFile:
    """Read, check and build a problem.

    Args:
        path: the TOML file; paths in it are relative to its folder.
        add: effects ``name@target`` to add besides the file's own.
        note: told in one line what was left out of the tables, or taken for granted.

    Raises:
        BadInput: anything in the file, the model or the tables that cannot be used.
    """
    path = Path(path)
    return problem_of(read_toml(path), path, add, note)


def problem_of(
    content: Mapping[str, Any],
    path: Path,
    add: Sequence[str] = (),
    note: Callable[[str], None] = lambda _line: None,
) -> ProblemFile:
    """:func:`load_problem` of a content that was read from the file, or changed since."""
    top = Section(content, str(path), known=TOP)
    if (schema := top.whole("schema", 1)) != 1:
        raise top.error("schema", f"version {schema} is unknown", "this version reads schema = 1")
    selection = _selection(top.section("selection", ("folds", "horizon_s", "alpha", "tolerance")))
    effects = top.section("effects", ("candidates", "add", "modules", "scope"))
    tables = top.texts("measurements")
    parameters = declared(top, effects)
    import_modules(effects)
    columns = columns_of(top, tables)
    simulator, parameters = build_simulator(top, path.parent, parameters, columns)
    for line in beside_bounds(simulator, parameters):
        note(line)
    if integrating := simulator.integrating_commands:
        who = " and ".join(integrating)
        note(f"{who}: integrates its command; each run is taken to begin with it at the model's first keyframe, or 0")
    measurement = _seen(_begun(top, _without(top, read_tables(top, tables, columns, simulator, note))), note)
    measurement = replace(measurement, between_rows=_between_rows(top))
    measurement = measurement.with_starts(known_starts(top.section("starts"), start_coordinates(simulator.signals)))
    measurement, tied = completed(simulator, measurement)
    for line in tied:
        note(line)
    candidates = check_candidates(effects, simulator)
    holdout = _holdout(top, measurement)
    _check_clock(measurement, selection, simulator.timestep, path)
    if "next" in top and simulator.commands:
        read_allowed(top, simulator)
    if 10 * simulator.timestep > selection.horizon_s:
        problem = f"a timestep of {simulator.timestep:g} s is too long for windows of {selection.horizon_s:g} s"
        raise top.error("model", problem, "give the model a timestep of a tenth of that or less")
    fit, held_out = split(measurement, holdout)
    for part, what in ((fit, "fit"), (held_out, "held-out")):
        _check_measured(part, what, path)
    simulator, added = add_effects(effects, add, simulator, fit, parameters.effects, selection.horizon_s)
    scope = _scope(top, effects, parameters, simulator, measurement, fit.runs)
    inputs = {path: "the problem file", path.parent / top.text("model"): "the model"}
    inputs |= {located(top, table): "a table of the problem" for table in tables}
    return ProblemFile(path, simulator, measurement, holdout, candidates, selection, added, scope, inputs)


def allowed_in(problem: ProblemFile) -> Allowed:
    """Read what the problem's ``[next]`` allows; raises :class:`BadInput` as :func:`.limits.read_allowed`."""
    return read_allowed(Section(read_toml(problem.path), str(problem.path)), problem.simulator)


def read_toml(path: Path) -> dict[str, Any]:
    """The parsed file; raises :class:`BadInput` with the line where it is missing, not UTF-8 or not TOML."""
    try:
        with path.open("rb") as file:
            raw = file.read(LARGEST + 1)
    except FileNotFoundError:
        raise BadInput("no such file", "name the problem file", where=str(path)) from None
    except IsADirectoryError:
        raise BadInput("is a folder", "name the problem file in it", where=str(path)) from None
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", "check its permissions", where=str(path)) from None
    if len(raw) > LARGEST or max(line.count(b".") for line in raw.split(b"\n")) > MOST_DOTS:
        # A key of n parts costs the parser n^2: a few hundred kB of dots would take hours.
        problem = f"has more than {LARGEST} bytes, or a line of more than {MOST_DOTS} dots"
        raise BadInput(problem, "write long lists on several lines, and data into tables", where=str(path))
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
    return Selection(**given, fixed_horizon="horizon_s" in section)  # a horizon that was asked for stands


def _scope(
    top: Section,
    effects: Section,
    parameters: Declared,
    simulator: Extensible,
    measurement: Measurement,
    fitted: Sequence[str],
) -> Scope | None:
    """Return the differences of the parameters between runs, every name in it checked."""
    scopes = effects.section("scope")
    for key in scopes.values:
        with scopes.at(key):
            check_effect(key, simulator)
    if (scope := parameters.scope) is None:
        return None
    for pattern, values in parameters.known.items():
        for address, value in values.items():
            with top.section("runs").section(pattern).at(address):
                if "@" in address:
                    check_constant(address, value, simulator)
    units = "units" if scope.units else "parameters"
    with top.at("runs" if scope.known else "groups" if scope.groups else units):
        scope.check(simulator.parameters, measurement.runs)
    with top.at(units):
        scope.check_units(fitted)
    return scope


def _begun(top: Section, measurement: Measurement) -> Measurement:
    """The runs without what comes before the motion that counts."""
    if not (seconds := top.number("skip_s", 0.0)):
        return measurement
    if seconds < 0:
        raise top.error("skip_s", f"{seconds:g} s is no time", "give the seconds to leave out, 0 or more")
    with top.at("skip_s"):
        return measurement.after(seconds)


def _between_rows(top: Section) -> BetweenRows | None:
    """How commands go between rows, where the file says so."""
    if "commands_between_rows" not in top:
        return None
    asked, known = top.text("commands_between_rows"), get_args(BetweenRows)
    if asked not in known:
        raise top.error("commands_between_rows", f"'{asked}' is unknown", f"use {' or '.join(known)}")
    return next(way for way in known if way == asked)


def _seen(measurement: Measurement, note: Callable[[str], None]) -> Measurement:
    """The measurement without columns that are empty throughout, as if they were not there."""
    seen = measurement.seen()
    if empty := [signal.name for signal in measurement.signals if signal not in seen.signals]:
        note(f"not measured in any run, and left out: {', '.join(empty)}")
    return seen


def _holdout(top: Section, measurement: Measurement) -> tuple[str, ...] | None:
    if "holdout" not in top:
        return None
    if not top.texts("holdout"):
        raise top.error("holdout", "no run is named", "name runs, or leave it out for the last third")
    held = _matched(top, "holdout", measurement)
    if len(held) == len(measurement.runs):
        raise top.error("holdout", "every run is held out", "leave at least one run to fit")
    return held


def _without(top: Section, measurement: Measurement) -> Measurement:
    """The runs that ``exclude`` does not name."""
    broken = set(_matched(top, "exclude", measurement)) if "exclude" in top else set()
    kept = [run for run in measurement.runs if run not in broken]
    if not kept:
        raise top.error("exclude", "every run is left out", "leave at least one run to fit")
    return measurement.select(kept) if broken else measurement


def _matched(top: Section, key: str, measurement: Measurement) -> tuple[str, ...]:
    """The runs that the names and globs under a key stand for."""
    patterns = top.texts(key)
    for pattern in patterns:
        if not any(matches(run, (pattern,)) for run in measurement.runs):
            if key != "exclude" and matches(pattern, top.texts("exclude", ())):
                raise top.error(key, f"'{pattern}' is left out by 'exclude'", "name runs that are left in")
            known = ", ".join(measurement.runs[:12]) + (", ..." if len(measurement.runs) > 12 else "")
            raise top.error(key, f"no run is called '{pattern}'", f"the tables have {known}")
    return tuple(run for run in measurement.runs if matches(run, patterns))


def _check_measured(measurement: Measurement, what: str, path: Path) -> None:
    if not bool(measurement.data["measured"].any()):
        names = ", ".join(signal.name for signal in measurement.signals)
        raise BadInput(
            f"the {what} runs ({', '.join(measurement.runs[:6])}) have no measured value of {names}",
            "every cell is empty or nan: fill the columns, or choose other runs under 'holdout'",
            where=str(path),
        )


def _check_clock(measurement: Measurement, selection: Selection, timestep: float, path: Path) -> None:
    """A clock in milliseconds that was taken for seconds leaves windows without rows, the other way runs: say so."""
    times = measurement.data["time"]
    for run, time, rows in zip(measurement.runs, times, measurement.lengths.tolist(), strict=True):
        step = float(time[:rows].diff().median())
        if 4 * step > selection.horizon_s:
            raise BadInput(
                f"run '{run}' has a row every {step:g} s, a window of {selection.horizon_s:g} s has too few of them",
                'say the unit of its time, [time] unit = "ms" (or "us"), or set selection.horizon_s to suit a slow log',
                where=str(path),
            )
        seconds = float(time[rows - 1] - time[0])
        if rows > FEWEST_STEPS and seconds < FEWEST_STEPS * timestep:
            raise BadInput(
                f"run '{run}' lasts {seconds:g} s, which is less than {FEWEST_STEPS} steps of the model",
                "say the unit of its time, [time] unit, or record longer runs",
                where=str(path),
            )
