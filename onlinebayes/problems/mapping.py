"""``[time]``, ``[signals."NAME"]`` and ``[commands.ACTUATOR]`` of a problem file -> which column becomes what.

value(t) = sign scale cell(t + latency) + offset,   the unit's factor in the scale;   a command's cell may have a factor

``[signals."qpos.*"]`` says the same of all that the glob fits; what a table of its own says of one wins, key by key.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from onlinebayes.measurements import CommandColumn, Signal, SignalColumn, TimeColumn
from onlinebayes.measurements.matching import matches
from onlinebayes.measurements.units import SI, to_si
from onlinebayes.problems.section import Section

CLOCK = ("column", "unit", "rest", "rest_unit", "offset_s")
COLUMN = ("column", "unit", "sign", "scale", "offset")
SIGNAL = (*COLUMN, "latency", "period", "sd", "resolution")
COMMAND = (*COLUMN, "enable", "times")


def time_column(section: Section) -> TimeColumn:
    """The clock's column, ``[time]``; ``time`` in seconds where nothing is said.

    Raises:
        BadInput: an unknown key, or a unit that is none of time.
    """
    return _clock(Section(_own(section), section.file, section.path, known=CLOCK), TimeColumn())


def table_clocks(section: Section, tables: Sequence[str]) -> dict[str, TimeColumn]:
    """The clocks of tables that have one of their own, ``[time."TABLE"]``; what is not said there is ``[time]``'s.

    Args:
        section: ``[time]``.
        tables: names or paths of the tables, of which a key is one, its end, or a glob.

    Raises:
        BadInput: an unknown key, a unit that is none of time, or a table that is not there.
    """
    first, found = time_column(section), dict[str, TimeColumn]()
    for pattern, value in section.values.items():
        if not isinstance(value, Mapping):
            continue
        named = [table for table in tables if matches(table, (pattern, f"*/{pattern}"))]
        if not named:
            raise section.error(pattern, "no table is called so", f"name one of {', '.join(tables[:6])}")
        clock = _clock(section.section(pattern, CLOCK), first)
        found |= dict.fromkeys(named, clock)
    return found


def _own(section: Section) -> dict[str, object]:
    """The keys of ``[time]`` that are no tables."""
    return {key: value for key, value in section.values.items() if key in CLOCK or not isinstance(value, Mapping)}


def _clock(section: Section, otherwise: TimeColumn) -> TimeColumn:
    scales = {}
    for key, scale in (("unit", otherwise.scale), ("rest_unit", otherwise.rest_scale)):
        with section.at(key):
            scales[key] = to_si(section.text(key), "s") if key in section else scale
    column = section.text("column", otherwise.column)
    rest = section.text("rest", "" if "column" in section else otherwise.rest)
    offset = section.number("offset_s", otherwise.offset) or 0.0
    return TimeColumn(column, scales["unit"], rest, scales["rest_unit"], offset)


def signal_columns(
    section: Section, names: Sequence[str], units: Mapping[str, str], there: Collection[str]
) -> list[SignalColumn]:
    """The mapped signals.

    Args:
        section: ``[signals]``, tables by the model's names, or by globs of them.
        names: the model's signals.
        units: signal -> SI unit, where known.
        there: columns of the tables; a glob stands for those of the model's names that were measured.

    Raises:
        BadInput: an unknown signal or key, a unit of another quantity, a scale of 0.
    """
    section = spread(section, names, SIGNAL, units, there)
    mapped = []
    for name in section.values:
        table = section.section(name, SIGNAL)
        scale, offset = _line(table, units.get(name, ""))
        with section.at(name):
            signal = Signal(name, units.get(name, ""), table.number("sd"), table.number("resolution"))
        latency = table.number("latency", 0.0) or 0.0
        period = table.number("period")
        if period is not None and not period > 0:
            raise table.error("period", f"{period:g} is no period", "write 6.283185307 for an angle in radians")
        mapped.append(SignalColumn(signal, table.text("column", ""), scale, offset, latency, period))
    return mapped


def command_columns(section: Section, names: Sequence[str]) -> list[CommandColumn]:
    """The mapped commands; any unit goes, for a command's own depends on the actuator.

    Args:
        section: ``[commands]``, tables by the model's names, or by globs of them.
        names: the model's actuators.

    Raises:
        BadInput: an unknown actuator, key or unit, a scale of 0.
    """
    section = spread(section, names, COMMAND)
    mapped = []
    for name in section.values:
        table = section.section(name, COMMAND)
        scale, offset = _line(table, "")
        enable, times = table.text("enable", ""), table.text("times", "")
        mapped.append(CommandColumn(name, table.text("column", ""), scale, offset, enable, times))
    return mapped


def is_glob(name: str, names: Sequence[str] = ()) -> bool:
    """Check whether a table's name is no name of the model, and stands for several."""
    return name not in names and any(sign in name for sign in "*?")


def spread(
    section: Section,
    names: Sequence[str],
    keys: Sequence[str],
    units: Mapping[str, str] | None = None,
    there: Collection[str] | None = None,
) -> Section:
    """The tables with those of globs written out for each name.

    A unit under a glob is that of the signals whose quantity it is: degrees under ``qpos.*`` of hinges, not of slides.

    Args:
        section: tables by the model's names, or by globs of them.
        names: of the model.
        keys: that a table may have.
        units: signal -> SI unit; of commands none.
        there: names that a glob stands for, beside those with a table of their own; all when None.

    Raises:
        BadInput: an unknown name or key, a glob that fits nothing, or under a glob a column, or a unit of no signal.
    """
    globs = [name for name in section.values if is_glob(name, names)]
    own = {name: table for name, table in section.values.items() if name not in globs}
    Section(own, section.file, section.path, known=names)
    found: dict[str, dict[str, Any]] = {}
    for glob in globs:
        table = section.section(glob, [key for key in keys if key != "column"])
        fitting = [name for name in names if matches(name, (glob,))]
        if not fitting:
            raise section.error(glob, "no name of the model is like it", f"the model has {', '.join(names[:12])}")
        suiting = fitting
        if "unit" in table and units is not None:
            with table.at("unit"):
                to_si(table.text("unit"))
            suiting = [name for name in fitting if _is_of(table.text("unit"), units.get(name, ""))]
        if not suiting:
            raise table.error("unit", f"'{table.text('unit')}' is no unit of {glob}", "give the unit of its quantity")
        for name in (one for one in fitting if there is None or one in there or one in own):
            given = {key: value for key, value in table.values.items() if key != "unit" or name in suiting}
            found.setdefault(name, {}).update(given)
    for name in own:
        found[name] = found.get(name, {}) | dict(section.section(name).values)
    return Section(found, section.file, section.path)


def _is_of(unit: str, si: str) -> bool:
    return SI[unit][0] == si


def _line(table: Section, unit: str) -> tuple[float, float]:
    """Scale (sign and unit included) and offset."""
    sign = table.number("sign", 1.0)
    if sign not in (1.0, -1.0):
        raise table.error("sign", f"{sign} is no sign", "write 1 or -1")
    factor = 1.0
    if "unit" in table:
        with table.at("unit"):
            factor = to_si(table.text("unit"), unit)
    scale = table.number("scale", 1.0) or 0.0
    if scale == 0.0:
        raise table.error("scale", "0 would erase it", "give what multiplies the column")
    return sign * scale * factor, table.number("offset", 0.0) or 0.0
