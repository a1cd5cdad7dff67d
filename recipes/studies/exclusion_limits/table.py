"""The study's table: the share found with its goal, the same by rig and effect, and every miss."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from onlinebayes.runs import ResultTable
from recipes.studies.blind_rigs.table import Goal, add_share
from recipes.studies.exclusion_limits.record import TIMES, Probe, Record

GOAL = 0.9


def tabulate(records: Sequence[Record], wanted: int) -> ResultTable:
    """All rows; ``wanted`` is how many records the whole study has."""
    table = ResultTable("exclusion-limits", "make exclusion-limits", sorted({record.seed for record in records}))
    table.add("records", len(records), goal=str(wanted), holds=len(records) == wanted)
    probes = sorted((probe for record in records for probe in record.probes), key=lambda probe: probe.name)
    _share(table, f"{TIMES:g} times the exclusion limit: found", probes, goal=GOAL)
    adequate = [record for record in records if record.verdict == "adequate"]
    table.add("records called adequate without any effect", len(adequate), unit=f"of {len(records)}")
    limited, unlimited = (sum(counts) for counts in ([r.limited for r in records], [len(r.unlimited) for r in records]))
    table.add("effects with a limit", limited, unit=f"of {limited + unlimited}, the rig's own of one size")
    if seconds := [probe.seconds for probe in probes]:
        spread = f"{min(seconds):.0f} to {max(seconds):.0f}"
        table.add("processor time an effect, median", statistics.median(seconds), spread=spread, unit="s")
    for rig in sorted({probe.rig for probe in probes}):
        _share(table, rig, [probe for probe in probes if probe.rig == rig])
    for name in sorted({_law(probe) for probe in probes}):
        _share(table, name, [probe for probe in probes if _law(probe) == name])
    for probe in probes:
        if not probe.found:
            table.add(f"MISS {probe.name}", f"{TIMES:g} × {probe.limit:.3g}", unit=_told(probe))
    for record in records:
        if record.ended:
            table.add(f"NO ANSWER {record.name}", record.ended)
    return table


def _law(probe: Probe) -> str:
    return probe.effect.split("@")[0]


def _share(table: ResultTable, name: str, probes: Sequence[Probe], goal: float | None = None) -> None:
    add_share(
        table, name, sum(probe.found for probe in probes), len(probes), None if goal is None else Goal(least=goal)
    )


def _told(probe: Probe) -> str:
    parts = [f"{probe.verdict}: {', '.join(probe.accepted) or 'nothing'} accepted"]
    if probe.equal:
        parts.append(f"tied with {', '.join(probe.equal)}")
    if probe.first:
        parts.append(f"first {probe.first}")
    return "; ".join([*parts, probe.refused] if probe.refused else parts)
