"""The study's table: the shares with their goals, the same by size, effect and rig, and every miss with what misled us.

Shares have Wilson's 95 % interval in the column ``spread``. Faint effects (ratio below 1.3) stand apart; so do pairs of
which one is faint beside the other, but only in a row of their own.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from onlinebayes.runs import ResultTable
from onlinebayes.simulators.effects import EFFECTS
from recipes.studies.blind_rigs.record import RIGHT, SIZES, Judged

Z = 1.96


@dataclass(frozen=True)
class Goal:
    """A share's bounds; None where any value is as good."""

    least: float | None = None
    most: float | None = None

    def __str__(self) -> str:
        if self.least is not None and self.most is not None:
            return f"{self.least:g} to {self.most:g}"
        return f">= {self.least:g}" if self.least is not None else f"<= {self.most:g}"

    def holds(self, value: float) -> bool:
        """Check whether a value is within the bounds."""
        return (self.least is None or value >= self.least) and (self.most is None or value <= self.most)


GOALS = {
    "one effect: ranked first": Goal(least=0.95),
    "two effects: both accepted": Goal(least=0.8),
    "two effects that both show: both accepted": Goal(least=0.8),
    "null: something accepted": Goal(most=0.03),
    "effects: something else accepted": Goal(most=0.03),
    "outside: verdict right": Goal(least=0.8),
    "tie: verdict right": Goal(least=0.8),
    "bounds: verdict right": Goal(least=0.8),
    "wiring: verdict right": Goal(least=0.95),
    "short: verdict right": Goal(least=0.95),
    "surplus: verdict right": Goal(least=0.9),
    "own: verdict right": Goal(least=0.9),
    "share of the improvement that the true effects give": Goal(least=0.9),
    "90 % intervals that hold the truth": Goal(least=0.85, most=0.95),
}

Rule = Callable[[Judged], bool]


def tabulate(found: Sequence[Judged], wanted: int, name: str = "blind-rigs") -> ResultTable:
    """All rows, overall ones first; ``wanted`` is how many cases the whole study has."""
    table = ResultTable(name, f"make {name}", sorted({judged.seed for judged in found}))
    ordered = sorted(found, key=lambda judged: (judged.rig, judged.kind, judged.seed))
    effects = [judged for judged in ordered if judged.kind == "effect" and judged.counts]
    table.add("cases judged", len(found), unit=_sizes(found), goal=str(wanted), holds=len(found) == wanted)
    _overall(table, ordered, effects)
    for size in SIZES:
        _named(table, f"size {size}", [judged for judged in effects if judged.size == size])
    for name in sorted({key.split("@")[0] for judged in effects if len(judged.hidden) == 1 for key in judged.hidden}):
        mine = [judged for judged in effects if [key.split("@")[0] for key in judged.hidden] == [name]]
        _named(table, name if name in EFFECTS else f"{name} (no candidate yet)", mine)
    for rig in sorted({judged.rig for judged in ordered}):
        _named(table, rig, [judged for judged in effects if judged.rig == rig])
        _share(table, f"{rig}: verdict right", [j for j in ordered if j.rig == rig and j.counts], lambda j: j.right)
    _misses(table, ordered)
    return table


def _overall(table: ResultTable, found: Sequence[Judged], effects: Sequence[Judged]) -> None:
    one, two = ([judged for judged in effects if len(judged.hidden) == n] for n in (1, 2))
    _share(table, "verdict right", [judged for judged in found if judged.counts], lambda judged: judged.right)
    _share(table, "one effect: ranked first", one, lambda judged: judged.first_right)
    _share(table, "one effect: ranked first, or tied with the first", one, lambda judged: judged.first_or_tied)
    _share(table, "one effect: accepted", one, lambda judged: judged.all_found)
    _share(table, "two effects: both accepted", two, lambda judged: judged.all_found)
    both_show = [judged for judged in two if judged.shows]
    _share(table, "two effects that both show: both accepted", both_show, lambda judged: judged.all_found)
    null, hiding = ([judged for judged in found if judged.kind == kind] for kind in ("null", "effect"))
    _share(table, "null: something accepted", null, lambda judged: bool(judged.innocent))
    _share(table, "effects: something else accepted", hiding, lambda judged: bool(judged.innocent))
    _share(table, "effects: something else accepted, not tied with what hides", hiding, lambda j: bool(j.accused))
    gone = [any(one.admits(key) for one in judged.answers) for judged in found for key in judged.contradicted]
    table.add("taken out for the held-out runs: was hidden", sum(gone), unit=f"of {len(gone)}")
    off = [judged for judged in found if judged.kind in ("surplus", "own")]
    _share(table, "surplus and own: something else accepted, not tied with what is off", off, lambda j: bool(j.accused))
    for kind in RIGHT:
        mine = [judged for judged in found if judged.kind == kind and judged.counts]
        _share(table, f"{kind}: verdict right", mine, lambda judged: judged.right)
    shares = [share for judged in effects if (share := judged.share) is not None]
    _mean(table, "share of the improvement that the true effects give", shares)
    intervals = sum(judged.intervals for judged in found)
    _count(table, "90 % intervals that hold the truth", sum(judged.covered for judged in found), intervals)
    spent = sorted(judged.seconds for judged in found)
    if spent:
        spread = f"{spent[0]:.0f} to {spent[-1]:.0f}"
        table.add("processor time a case, median", statistics.median(spent), spread=spread, unit="s")
        table.add("cases out of time", sum(judged.ended == "out of time" for judged in found), unit=f"of {len(found)}")


def _sizes(found: Iterable[Judged]) -> str:
    sizes = [judged.size for judged in found if judged.kind == "effect"]
    return f"effects: {', '.join(f'{sizes.count(size)} {size}' for size in SIZES)}"


def _named(table: ResultTable, name: str, effects: Sequence[Judged]) -> None:
    one = [judged for judged in effects if len(judged.hidden) == 1]
    _share(table, f"{name}: one effect ranked first", one, lambda judged: judged.first_right)
    _share(table, f"{name}: two effects accepted", [j for j in effects if len(j.hidden) == 2], lambda j: j.all_found)


def _share(table: ResultTable, name: str, of: Sequence[Judged], rule: Rule) -> None:
    _count(table, name, sum(map(rule, of)), len(of))


def _count(table: ResultTable, name: str, right: int, total: int) -> None:
    add_share(table, name, right, total, GOALS.get(name))


def add_share(table: ResultTable, name: str, right: int, total: int, goal: Goal | None = None) -> None:
    """A row with a share and its interval; none of nothing."""
    if not total:
        return
    value, (low, high) = right / total, wilson(right, total)
    holds = None if goal is None else goal.holds(value)
    goal_text = None if goal is None else str(goal)
    table.add(name, value, spread=f"{low:.2f} to {high:.2f}", unit=f"{right} of {total}", goal=goal_text, holds=holds)


def _mean(table: ResultTable, name: str, values: Sequence[float]) -> None:
    if not values:
        return
    mean, goal = statistics.fmean(values), GOALS[name]
    quartiles = statistics.quantiles(values, n=4, method="inclusive") if len(values) > 1 else [mean] * 3
    spread = f"quartiles {', '.join(f'{value:.2f}' for value in quartiles)}"
    table.add(name, mean, spread=spread, unit=f"mean of {len(values)}", goal=str(goal), holds=goal.holds(mean))


def wilson(right: int, total: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share (1927)."""
    p, z2 = right / total, Z * Z
    middle = (p + z2 / (2 * total)) / (1 + z2 / total)
    reach = Z / (1 + z2 / total) * math.sqrt(p * (1 - p) / total + z2 / (4 * total**2))
    return max(0.0, middle - reach), min(1.0, middle + reach)


def _misses(table: ResultTable, found: Iterable[Judged]) -> None:
    for judged in found:
        if judged.missed:
            hidden = ", ".join(judged.hidden) or judged.fault or "nothing"
            table.add(f"MISS {judged.name}", f"{hidden} ({judged.kind}{_ratio(judged)})", unit=told(judged))


def told(judged: Judged) -> str:
    """Describe the verdict of refine, its first-ranked candidate, and why the right name was refused."""
    if judged.ended:
        return f"no answer: {judged.ended}"
    parts = [f"{judged.verdict}: {', '.join(judged.accepted) or 'nothing'} accepted"]
    if judged.equal:
        parts.append(f"tied with {', '.join(judged.equal)}")
    if judged.first:
        gain = "" if judged.gain is None else f", gain {judged.gain:.3g} ± {judged.gain_se or 0.0:.2g}"
        parts.append(f"first {judged.first}{gain}")
    parts += [f"{key} {why}{_without(judged, key)}" for key, why in judged.refused.items()]
    parts += [f"widened {', '.join(judged.widened)}"] if judged.widened else []
    parts += [f"wiring: {judged.wiring}"] if judged.wiring else []
    return "; ".join(parts)


def _without(judged: Judged, key: str) -> str:
    return f" (without it the true model errs {judged.beside[key]:.2f} times)" if key in judged.beside else ""


def _ratio(judged: Judged) -> str:
    size = judged.size if judged.kind == "effect" else ""
    errors = (judged.before, judged.after, judged.reference)
    told = "" if judged.before is None else " ".join("-" if e is None else f"{e:.2f}" for e in errors)
    return "".join(f", {part}" for part in (size, told) if part)
