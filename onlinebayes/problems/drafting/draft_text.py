"""The words of a first problem file: comments behind its values, and what could not be matched."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from onlinebayes.parameters import ParameterSpace
from onlinebayes.problems.drafting.matching import Match
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
        name: of the file.
        untied: what is to be said of clocks that do not overlap.
    """
    comments = _comments(content, simulator, parameters, {one.name: one.why for one in found})
    text = to_toml(content, head=HEAD.format(name=one_line(name)), comments=comments)
    return (
        text
        + "".join(f"\n# CLOCKS: {one_line(line)}\n" for line in untied)
        + _lacking(missing)
        + _more(simulator, content.get("signals", {}))
    )


def mapped(matches: Sequence[Match]) -> dict[str, dict[str, dict[str, str]]]:
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
        ("holdout",): "runs that are opened at the end, for the reported error",
        ("ignore",): "columns that look like the model's and are not",
    }
    free = MujocoSimulator(simulator.spec, parameters, threads=1)
    for (name, bounds), value in zip(parameters.items(), free.nominal.tolist(), strict=True):
        comments["parameters", name] = f"{bounds.unit or 'no unit'}; the model has {value:g}"
    comments["time", "column"] = f"{why.get('time', Match.why)}: check it"
    comments["time", "unit"] = "check it"
    comments["time", "rest"] = "what has passed since then [ns], in a column of its own"
    for kind in ("signals", "commands"):
        for name in content.get(kind, {}):  # type: ignore[attr-defined]
            proposed = why[f"ctrl.{name}" if kind == "commands" else name]
            comments[kind, name, "column"] = f"{proposed}: check it"
            comments[kind, name, "unit"] = "as the column's name says"
    return comments


def _lacking(missing: Mapping[str, tuple[str, ...]]) -> str:
    lines = [one_line(f"MISSING: {name}: {doubt(columns)}; {cure(name)}") for name, columns in missing.items()]
    return "".join(f"\n# {line}" for line in lines) + ("\n" if missing else "")


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
