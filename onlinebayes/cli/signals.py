"""``[signals]`` of a problem file: how columns of the tables become signals of the model.

value(t) = sign scale cell(t + latency) + offset
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from onlinebayes.cli.section import Section
from onlinebayes.measurements import Signal, SignalColumn
from onlinebayes.measurements.units import to_si

KEYS = ("column", "unit", "sign", "scale", "offset", "latency", "sd", "resolution")


def signal_columns(section: Section, names: Sequence[str], units: Mapping[str, str]) -> list[SignalColumn]:
    """One for each signal that the section names.

    Args:
        section: ``[signals]``.
        names: the model's signals.
        units: signal -> SI unit.

    Raises:
        BadInput: a signal that the model lacks, an unknown key or unit, a value that makes no sense.
    """
    Section(section.values, section.file, section.path, known=names)
    return [_column(section, name, units.get(name, "")) for name in section.values]


def _column(section: Section, name: str, unit: str) -> SignalColumn:
    table = section.section(name, KEYS)
    sign = table.number("sign", 1.0)
    if sign not in (1.0, -1.0):
        raise table.error("sign", f"{sign} is no sign", "write 1 or -1")
    factor = 1.0
    if "unit" in table:
        with table.at("unit"):
            factor = to_si(table.text("unit"), unit)
    scale = table.number("scale", 1.0) or 0.0
    if scale == 0.0:
        raise table.error("scale", "0 would erase the signal", "give what multiplies the column")
    with section.at(name):
        signal = Signal(name, unit, table.number("sd"), table.number("resolution"))
    return SignalColumn(
        signal,
        table.text("column", ""),
        sign * scale * factor,
        table.number("offset", 0.0) or 0.0,
        table.number("latency", 0.0) or 0.0,
    )
