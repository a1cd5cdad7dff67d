"""``onlinebayes init model.xml log.csv --out problem.toml``: a first problem file, to be read and edited.

Columns are matched by name (:mod:`.matching`), parameters chosen by what the logs tell apart (:mod:`.freeing`), the
last third of the runs is held out. What could not be matched stands in the file as a comment and is printed; with
everything matched the file loads as it is.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from onlinebayes.cli.freeing import free_parameters
from onlinebayes.cli.matching import Match, could_be, match, match_time
from onlinebayes.cli.model import signal_units
from onlinebayes.cli.outputs import check_apart
from onlinebayes.cli.servo_inputs import servo_inputs
from onlinebayes.criticism.fitting.closed_loops import completed, follow
from onlinebayes.criticism.report.toml import to_toml
from onlinebayes.measurements import CommandColumn, Measurement, Signal, SignalColumn, TableReader, TimeColumn
from onlinebayes.measurements.formats import Source, open_source
from onlinebayes.measurements.joining import joined
from onlinebayes.measurements.units import to_si
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import BadInput, write_atomic
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.sensors import measured_sensors
from onlinebayes.simulators.mujoco.wrenches import is_wrench, with_wrenches

LIKE_THE_MODEL = ("ctrl.", "enable.", "qpos.", "qvel.", "qfrc.", "xfrc.")
LONGEST_STEP = {"s": 1.0, "ms": 1e3, "us": 1e6}
"""Units of a clock, each with the step of a log of one row a second."""
MOST_NAMED = 4
"""How many of the columns that a name could be are listed."""
HEAD = """\
A first problem file, made by onlinebayes init: read every line, above all the bounds.
Then: onlinebayes compare {name} --out out   (how wrong is the model?)
      onlinebayes refine {name} --out out    (what is missing?)"""


@dataclass(frozen=True)
class Draft:
    """A first problem file.

    Args:
        text: of the file.
        matches: columns that were found.
        missing: names of the model without a column, with those that it could be; nothing when the file is complete.
        follows: positions without a column that constraints tie to those that have one.
        unused: columns of the logs that nothing takes.
    """

    text: str
    matches: tuple[Match, ...]
    missing: Mapping[str, tuple[str, ...]]
    follows: tuple[str, ...]
    unused: tuple[str, ...]


def init(model: str, logs: Sequence[str], out: str, force: bool = False) -> int:
    """Write the file and print what was matched and what was not; returns the exit status.

    Args:
        model: path of an MJCF file.
        logs: paths of tables, at least one.
        out: where the problem file goes.
        force: write over a file that is there.

    Raises:
        BadInput: the model or a log cannot be read or would be written over, or the file is there already.
    """
    target = Path(out)
    check_apart([target], {**{Path(log): "a log" for log in logs}, Path(model): "the model"})
    if target.exists() and not force:
        raise BadInput("the file is there already", "choose another --out, or write over it with --force", where=out)
    if not target.parent.is_dir():
        raise BadInput("its folder is not there", "make it, or choose another --out", where=out)
    drafted = draft(Path(model), [Path(log) for log in logs], target)
    write_atomic(target, drafted.text)
    for found in drafted.matches:
        said = "" if found.exact else f"   ({found.why}: check it)"
        print(f"matched:   {found.name} <- {found.column}{f' [{found.unit}]' if found.unit else ''}{said}")
    for name, columns in drafted.missing.items():
        print(f"missing:   {name}: {_doubt(columns)}; {_cure(name)}")
    if drafted.follows:
        print(f"follows:   {', '.join(drafted.follows)}, from the others by the model's <equality>")
    if drafted.unused:
        print(f"unused:    {', '.join(drafted.unused)}")
    print(f"wrote:     {target}")
    return 0


def draft(model: Path, logs: Sequence[Path], target: Path) -> Draft:
    """The problem file for a model and its logs, to stand at ``target``."""
    if not model.is_file():
        raise BadInput("no such file", "name the MJCF file of the model", where=str(model))
    simulator = MujocoSimulator(model, threads=1)
    sources = [open_source(log) for log in logs]
    clock = _clock(sources, _shared(sources))
    if clock is not None:
        sources = joined(sources, TimeColumn(clock.column, to_si(clock.unit or "s")))
    shared = _shared(sources)
    wanted = (*simulator.signals, *(f"ctrl.{name}" for name in simulator.commands))
    column = "" if clock is None else clock.column
    own = (
        *measured_sensors(simulator.model, shared),
        *(f"enable.{name}" for name in simulator.commands),
        *_wrenches(simulator, shared),
    )
    told = servo_inputs(simulator.model)
    matches = match(wanted, [name for name in shared if name not in ("run", column)], told)
    if clock is None and not matches:
        raise BadInput(
            "no column is one of the model's, and none a clock",
            f"the model has {_few(wanted)}; the log has {_few(shared)}; write a problem file that maps them: "
            f'[time] column = "...", [signals."{(*simulator.signals, "qpos.joint")[0]}"] column = "..."',
            where=", ".join(map(str, logs)),
        )
    have = {found.name for found in matches}
    seen = have | {name.replace("qvel.", "qpos.", 1) for name in have if name.startswith("qvel.")}
    needed = [name for name in wanted if not name.startswith("qvel.") and name not in seen]
    follows = follow(simulator, have) & {*needed}
    taken = {"run", column, *own, *(found.column for found in matches)}
    left = [name for name in shared if name not in taken and not name.startswith(LIKE_THE_MODEL)]
    numbers = [name for name in left if needed and _numeric(sources, name)]
    lacking = {name: could_be(name, wanted, numbers, told) for name in needed if name not in follows}
    if guess := _last_one(lacking):
        matches, lacking, taken = (*matches, guess), {}, taken | {guess.column}
    clocks = () if clock else tuple(name for name in shared if name not in taken and _rises(sources, name))
    missing = ({} if clock else {"time": clocks}) | lacking
    unused = tuple(dict.fromkeys(name for source in sources for name in source.names if name not in taken))
    measurement = _measurement(simulator, logs, clock, matches, unused) if clock and not missing else None
    if measurement is None:
        _check_rows(sources, matches, column)
    content = {
        "schema": 1,
        "model": _relative(model, target),
        "measurements": [_relative(log, target) for log in logs],
    }
    runs = _runs(sources)
    if len(runs) > 1:
        content["holdout"] = runs[-(len(runs) // 3 or 1) :]
    if ignored := [name for name in unused if name.startswith(LIKE_THE_MODEL)]:
        content["ignore"] = ignored
    parameters = free_parameters(simulator, measurement and completed(simulator, measurement)[0])
    content["parameters"] = {name: [bounds.low, bounds.high] for name, bounds in parameters.items()}
    if clock and not clock.exact:
        content["time"] = {"column": clock.column, "unit": clock.unit}
    content |= _mapped(matches)
    found = matches if clock is None or clock.exact else (clock, *matches)
    comments = _comments(content, simulator, parameters, {one.name: one.why for one in found})
    text = to_toml(content, head=HEAD.format(name=target.name), comments=comments)
    text += _lacking(missing) + _more(simulator, content.get("signals", {}))
    return Draft(text, found, missing, tuple(name for name in needed if name in follows), unused)


def _shared(sources: Sequence[Source]) -> list[str]:
    """The columns that every log has."""
    return [name for name in sources[0].names if all(name in other.names for other in sources)]


def _last_one(lacking: Mapping[str, tuple[str, ...]]) -> Match | None:
    """The one column left for the one actuator left, where nothing else of the model lacks one."""
    (name, columns), *others = lacking.items() or [("", ())]
    if others or len(columns) != 1 or not name.startswith("ctrl."):
        return None
    return Match(name, columns[0], why="a guess, no other column is left")


def _numeric(sources: Sequence[Source], column: str) -> bool:
    """Whether every log has numbers there."""
    try:
        return all(np.isfinite(source.columns([column])[column]).any() for source in sources)
    except BadInput:
        return False


def _rises(sources: Sequence[Source], column: str) -> bool:
    """Whether it could be a clock: numbers that rise from row to row, but where a run begins."""
    try:
        steps = [np.diff(source.columns([column])[column]) for source in sources]
    except BadInput:
        return False
    return all(len(step) > 0 and float(np.mean(step > 0)) > 0.9 for step in steps)


def _clock(sources: Sequence[Source], shared: Sequence[str]) -> Match | None:
    """The clock's column; where its name has no unit, the one in which a log has between 1 and 1000 rows a second."""
    clock = match_time(shared)
    if clock is None or clock.exact or clock.unit:
        return clock
    ticks = sources[0].columns([clock.column])[clock.column]
    step = float(np.median(np.abs(np.diff(ticks)))) if len(ticks) > 1 else 1.0
    unit = next((unit for unit, longest in LONGEST_STEP.items() if step <= longest), "ns")
    return replace(clock, unit=unit)


def _check_rows(sources: Sequence[Source], matches: Sequence[Match], clock: str) -> None:
    """Meet what is wrong with the rows of logs that cannot be read as a whole yet."""
    commands = [found.column for found in matches if found.name.startswith("ctrl.")]
    numbers = {clock, *(found.column for found in matches)} - {""}
    for source in sources:
        text = [name for name in ("run",) if name in source.names]
        source.columns(sorted(numbers | {*text}), text, commands)


def _few(names: Sequence[str], most: int = 6) -> str:
    """The first of some names, and how many more there are."""
    shown = ", ".join(f"'{name[:40]}'" for name in names[:most])
    return shown + (f" and {len(names) - most} more" if len(names) > most else "") or "nothing"


def _wrenches(simulator: MujocoSimulator, columns: Sequence[str]) -> list[str]:
    """The columns of wrenches from outside that act on bodies of the model."""
    found = []
    for column in filter(is_wrench, columns):
        with contextlib.suppress(BadInput):
            with_wrenches(simulator.spec, [column])
            found.append(column)
    return found


def _measurement(
    simulator: MujocoSimulator, logs: Sequence[Path], clock: Match, matches: Sequence[Match], unused: Sequence[str]
) -> Measurement:
    """The logs as the problem file will read them."""
    units = signal_units(simulator)
    mapped = [
        SignalColumn(
            Signal(found.name, units.get(found.name, "")), found.column, to_si(found.unit) if found.unit else 1.0
        )
        for found in matches
        if not found.name.startswith("ctrl.")
    ]
    commanded = [
        CommandColumn(found.name.removeprefix("ctrl."), found.column, to_si(found.unit) if found.unit else 1.0)
        for found in matches
        if found.name.startswith("ctrl.")
    ]
    time = TimeColumn(clock.column, to_si(clock.unit or "s"))
    signals = [Signal(name) for name in simulator.signals]
    ignore = (*unused, "xfrc.*")  # what pushed is the problem file's to add to the model
    return TableReader(signals, simulator.commands, mapped, commanded, time, ignore).read(logs)


def _runs(sources: Sequence[Source]) -> list[str]:
    """Names of the runs, in order."""
    found: list[str] = []
    for source in sources:
        named = "run" in source.names
        found += [str(run) for run in source.columns(["run"], ["run"])["run"]] if named else [source.path.stem]
    return list(dict.fromkeys(found))


def _mapped(matches: Sequence[Match]) -> dict[str, dict[str, dict[str, str]]]:
    """``[signals]`` and ``[commands]`` for the columns that have other names."""
    found: dict[str, dict[str, dict[str, str]]] = {}
    for one in matches:
        if one.exact:
            continue
        kind, name = (
            ("commands", one.name.removeprefix("ctrl.")) if one.name.startswith("ctrl.") else ("signals", one.name)
        )
        found.setdefault(kind, {})[name] = {"column": one.column} | ({"unit": one.unit} if one.unit else {})
    return found


def _comments(
    content: dict[str, object], simulator: MujocoSimulator, parameters: ParameterSpace, why: Mapping[str, str]
) -> dict[tuple[str, ...], str]:
    comments: dict[tuple[str, ...], str] = {
        ("model",): "the MJCF file",
        ("measurements",): "tables: run, time, commands, positions",
        ("holdout",): "runs that are opened once, at the end, for the reported error",
        ("ignore",): "columns that look like the model's and are not",
    }
    free = MujocoSimulator(simulator.spec, parameters, threads=1)
    for (name, bounds), value in zip(parameters.items(), free.nominal.tolist(), strict=True):
        comments["parameters", name] = f"{bounds.unit or 'no unit'}; the model has {value:g}"
    comments["time", "column"] = "proposed by its name: check it"
    comments["time", "unit"] = "check it"
    for kind in ("signals", "commands"):
        for name in content.get(kind, {}):  # type: ignore[attr-defined]
            proposed = why[f"ctrl.{name}" if kind == "commands" else name]
            comments[kind, name, "column"] = f"{proposed}: check it"
            comments[kind, name, "unit"] = "as the column's name says"
    return comments


def _lacking(missing: Mapping[str, tuple[str, ...]]) -> str:
    lines = [f"\n# MISSING: {name}: {_doubt(columns)}; {_cure(name)}" for name, columns in missing.items()]
    return "".join(lines) + ("\n" if missing else "")


def _doubt(columns: Sequence[str]) -> str:
    """What stands in a name's way."""
    if len(columns) < 2:
        return "no column was found" if not columns else f"perhaps {columns[0]}"
    few = columns[:MOST_NAMED]
    more = f" or {len(columns) - len(few)} more" if len(columns) > len(few) else ""
    return f"{', '.join(few[:-1])}{', ' if more else ' or '}{few[-1]}{more} could be it"


def _cure(name: str) -> str:
    if name == "time":
        return 'name it here: [time] column = "...", unit = "ms"'
    kind, _, target = name.partition(".")
    table = f"[commands.{target}]" if kind == "ctrl" else f'[signals."{name}"]'
    return f'name it here: {table} column = "..."'


def _more(simulator: MujocoSimulator, mapped: object) -> str:
    """What else could stand here, as comments; a table that stands above is not begun a second time."""
    signal = simulator.signals[0] if simulator.signals else "qpos.joint"
    table = f'[signals."{signal}"]'
    begun = isinstance(mapped, Mapping) and signal in mapped
    return (
        f"\n# {f'In {table} above may stand, too:' if begun else table}\n"
        "# sd = 1e-3           # scatter of the logged values [SI], where you know it; else estimated from the data\n"
        '# unit = "deg"        # or sign = -1, scale, offset: how the column becomes the model\'s quantity\n'
        "# [selection]\n"
        "# horizon_s = 1.0     # seconds over which the model is replayed from a measured state\n"
    )


def _relative(path: Path, target: Path) -> str:
    return Path(os.path.relpath(path.resolve(), target.resolve().parent)).as_posix()
