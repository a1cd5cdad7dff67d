"""The words of a first problem file: comments behind its values, and what could not be matched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from onlinebayes.measurements.clocks import TIME
from onlinebayes.measurements.units import SI
from onlinebayes.parameters import ParameterSpace
from onlinebayes.problems.drafting.matching import Match
from onlinebayes.problems.drafting.surroundings import weld_of
from onlinebayes.runs import one_line, to_toml
from onlinebayes.simulators.mujoco import MujocoSimulator

MOST_NAMED = 4
"""The number of columns that are listed at most where several could be a name."""
HEAD = """\
A first problem file, made by onlinebayes init: read every line, above all the bounds.
Then: onlinebayes compare {name} --out out   (how wrong is the model?)
      onlinebayes refine {name} --out out    (what is missing?)"""


def text_of(
    content: dict[str, object],
    simulator: MujocoSimulator,
    parameters: ParameterSpace,
    found: Sequence[Match],
    missing: Mapping[str, tuple[str, ...]],
    fixed: Mapping[str, str],
    questions: Sequence[str],
    name: str,
    untied: Sequence[str] = (),
) -> str:
    """The file's text: its values with comments behind them, what is missing, and what else could stand there.

    Args:
        content: tables as ``tomllib`` gives them.
        simulator: the model.
        parameters: those that may be fitted, with their bounds.
        found: columns that were matched, the clock among them where it has another name.
        missing: names of the model without a column, with those that it could be.
        fixed: free joints that nobody measured -> their bodies.
        questions: of the values of the log, to be answered by who knows.
        name: of the file.
        untied: what is to be said of clocks that do not overlap.
    """
    comments = _comments(content, simulator, parameters, found)
    text = to_toml(content, head=HEAD.format(name=one_line(name)), comments=comments)
    clocks = "".join(f"\n# CLOCKS: {one_line(line)}\n" for line in untied)
    more = _more(simulator, content.get("signals", {}))
    return text + clocks + _lacking(missing) + _welds(fixed) + _asked(questions) + more


def mapped(matches: Sequence[Match], units: Mapping[str, str]) -> dict[str, dict[str, dict[str, str | float]]]:
    """``[signals]`` and ``[commands]`` for the columns that have other names or units.

    A unit that the values of all columns of a kind show is said once, for ``"qpos.*"``.

    Args:
        matches: what was found.
        units: signal -> SI unit.
    """
    found: dict[str, dict[str, dict[str, str | float]]] = {}
    at_once = _at_once(matches, units)
    for (kind, glob), unit in at_once.items():
        found.setdefault(kind, {})[glob] = {"unit": unit}
    for one in matches:
        kind, name = _place(one.name)
        if one.name.startswith("enable."):
            found.setdefault(kind, {}).setdefault(name, {})["enable"] = one.column
            continue
        given: dict[str, str | float] = {"column": one.column} if one.column != one.name else {}
        said = (kind, _glob(one.name)) in at_once and one.unit == at_once[kind, _glob(one.name)]
        given |= {key: value for key, value in one.keys.items() if not (key == "unit" and said)}
        if given:
            found.setdefault(kind, {}).setdefault(name, {}).update(given)
    return found


def _place(name: str) -> tuple[str, str]:
    """The kind of table and the name in it of a signal, a command or a switch."""
    command = name.removeprefix("ctrl.").removeprefix("enable.")
    return ("commands", command) if command != name else ("signals", name)


def _glob(name: str) -> str:
    return "*" if name.startswith("ctrl.") else f"{name.partition('.')[0]}.*"


def _at_once(matches: Sequence[Match], units: Mapping[str, str]) -> dict[tuple[str, str], str]:
    """Globs under which one unit may stand: several columns show it, and each other of them is of another quantity."""
    found: dict[tuple[str, str], str] = {}
    for kind, glob in dict.fromkeys((_place(one.name)[0], _glob(one.name)) for one in matches):
        own = [one for one in matches if one.name.partition(".")[0] != "enable" and _glob(one.name) == glob]
        shown = [one for one in own if one.unit and one.unit_why != Match.unit_why]
        if len(shown) < 2 or len({one.unit for one in shown}) != 1:
            continue
        unit = SI[shown[0].unit][0]
        if all(one in shown or (kind == "signals" and units.get(one.name, "") != unit) for one in own):
            found[kind, glob] = shown[0].unit
    return found


def _comments(
    content: dict[str, object], simulator: MujocoSimulator, parameters: ParameterSpace, found: Sequence[Match]
) -> dict[tuple[str, ...], str]:
    comments: dict[tuple[str, ...], str] = {
        ("model",): "the MJCF file",
        ("measurements",): "tables: run, time, commands, positions",
        ("holdout",): "runs that are opened at the end, for the reported error",
        ("ignore",): "columns that look like the model's and are not",
        ("model_edit", "weld"): "no column shows how these move, or moves them: they stay where the model has them",
    }
    free = MujocoSimulator(simulator.spec, parameters, threads=1)
    for (name, bounds), value in zip(parameters.items(), free.nominal.tolist(), strict=True):
        comments["parameters", name] = f"{bounds.unit or 'no unit'}; the model has {value:g}"
    clocks = [match.why for match in found if match.name == TIME]
    comments["time", "column"] = f"{', '.join(dict.fromkeys(clocks)) or Match.why}: check it"
    comments["time", "unit"] = "check it"
    comments["time", "rest"] = "what has passed since then [ns], in a column of its own"
    for one in (match for match in found if match.name != TIME):
        kind, name = _place(one.name)
        if one.name.startswith("enable."):
            comments[kind, name, "enable"] = f"{one.why}: check it"
            continue
        comments[kind, name, "column"] = f"{one.why}: check it"
        said = one.unit_why
        comments[kind, name, "unit"] = comments[kind, name, "scale"] = said
        comments.setdefault((kind, _glob(one.name), "unit"), said) if one.unit else None
    return comments


def _lacking(missing: Mapping[str, tuple[str, ...]]) -> str:
    lines = [one_line(f"MISSING: {name}: {doubt(columns)}; {cure(name)}") for name, columns in missing.items()]
    return "".join(f"\n# {line}" for line in lines) + ("\n" if missing else "")


def _welds(fixed: Mapping[str, str]) -> str:
    """What fixes the bodies that nobody measured, as a comment."""
    if not fixed:
        return ""
    lines = [one_line(f"MISSING: {weld_of(joint, body)}") for joint, body in fixed.items()]
    lines += to_toml({"model_edit": {"weld": list(fixed.values())}}).strip().split("\n")
    return "\n" + "".join(f"# {line}\n" for line in lines)


def _asked(questions: Sequence[str]) -> str:
    return "".join(f"\n# {one_line(f'CHECK: {question}')}" for question in questions) + ("\n" if questions else "")


def doubt(columns: Sequence[str]) -> str:
    """Say why a name has no column: none was found, or several could be it."""
    if len(columns) < 2:
        return "no column was found" if not columns else f"perhaps {columns[0]}"
    few = columns[:MOST_NAMED]
    more = f" or {len(columns) - len(few)} more" if len(columns) > len(few) else ""
    return f"{', '.join(few[:-1])}{', ' if more else ' or '}{few[-1]}{more} could be it"


def cure(name: str) -> str:
    """Say what to write where a name has no column."""
    if name == "time":
        return 'name it here: [time] column = "...", unit = "ms"'
    kind, _, target = name.partition(".")
    table = f"[commands.{target}]" if kind == "ctrl" else f'[signals."{name}"]'
    return f'name it here: {table} column = "..."'


def _more(simulator: MujocoSimulator, mapped: object) -> str:
    """Write the other keys that could stand here, as comments; a table that stands above is not begun again."""
    signal = simulator.signals[0] if simulator.signals else "qpos.joint"
    table = one_line(f'[signals."{signal}"]')
    begun = isinstance(mapped, Mapping) and signal in mapped
    return (
        f"\n# {f'In {table} above may stand, too:' if begun else table}\n"
        "# sd = 1e-3           # scatter of the logged values [SI], where you know it; else estimated from the data\n"
        '# unit = "deg"        # or sign = -1, scale, offset: how the column becomes the model\'s quantity\n'
        "# [selection]\n"
        "# horizon_s = 1.0     # seconds over which the model is replayed from a measured state\n"
    )
