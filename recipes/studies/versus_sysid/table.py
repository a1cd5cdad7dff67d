"""The comparison's table: error, names and time of each method, then every case.

| row                 | what                                                                                        |
|---------------------|---------------------------------------------------------------------------------------------|
| held-out error      | median over cases; no answer counts as infinitely wrong                                      |
| smallest error      | cases in which the method's error is within 2 % of the smallest of all                      |
| right names         | hidden effects that were named, twins of the rig included                                   |
| false names         | claims that name nothing hidden, over all cases and over those that hide nothing            |
| processor time      | median of the fit, without making the case and without the base fit that sysid is given |
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence

from onlinebayes.runs import ResultTable
from recipes.studies.versus_sysid.judging import COST, Outcome
from recipes.studies.versus_sysid.methods import METHODS

TITLES: Mapping[str, str] = {
    "base": "engineer's model, fitted",
    "ours": "onlinebayes refine",
    "sysid": "mujoco.sysid",
}
COMPETING = tuple(method for method in METHODS if method != "base")
CLOSE = 1.02
FASTER = 3.0

Cases = Mapping[str, Mapping[str, Outcome]]


def tabulate(found: Sequence[Outcome], command: str, wanted: int) -> ResultTable:
    """All rows.

    Args:
        found: the judged trials; cases that not every method has been tried on are left out.
        command: that the table is printed by.
        wanted: cases of the whole study.
    """
    by_case: dict[str, dict[str, Outcome]] = {}
    for outcome in found:
        by_case.setdefault(outcome.case, {})[outcome.method] = outcome
    cases = {name: tried for name, tried in by_case.items() if tried.keys() >= set(METHODS)}
    table = ResultTable("versus-sysid", command, sorted({int(name.rsplit("-", 1)[1]) for name in cases}))
    nulls = sum(not _hidden(tried) for tried in cases.values())
    table.add("cases compared", len(cases), unit=f"{nulls} hide nothing", goal=str(wanted), holds=len(cases) == wanted)
    if cases:
        _errors(table, cases)
        _names(table, cases)
        _times(table, cases)
    _cost(table, [outcome for outcome in found if outcome.method == COST])
    for name, tried in cases.items():
        _case(table, name, tried)
    return table


def error_of(outcome: Outcome) -> float:
    """Held-out error [floors]; inf without an answer."""
    return math.inf if outcome.error is None else outcome.error


def _hidden(tried: Mapping[str, Outcome]) -> tuple[str, ...]:
    return next((outcome.hidden for outcome in tried.values() if outcome.hidden), ())


def _errors(table: ResultTable, cases: Cases) -> None:
    errors = {method: [error_of(tried[method]) for tried in cases.values()] for method in METHODS}
    medians = {method: statistics.median(values) for method, values in errors.items()}
    for method in METHODS:
        _lead(table, f"held-out error, median: {TITLES[method]}", method, medians, "floors", "smallest of all", min)
    for method in METHODS:
        ratios = [a / b for a, b in zip(errors[method], errors["base"], strict=True)]
        geometric = math.exp(statistics.fmean(map(math.log, ratios))) if all(map(math.isfinite, ratios)) else math.inf
        table.add(f"held-out error over the engineer's model, geometric mean: {TITLES[method]}", geometric)
    best = [min(error_of(tried[method]) for method in COMPETING) for tried in cases.values()]
    wins = {m: sum(e <= CLOSE * b for e, b in zip(errors[m], best, strict=True)) for m in COMPETING}
    for method in COMPETING:
        name = f"smallest error, within 2 %: {TITLES[method]}"
        _lead(table, name, method, wins, f"of {len(cases)}", "most of all", max)


def _names(table: ResultTable, cases: Cases) -> None:
    hidden = sum(len(_hidden(tried)) for tried in cases.values())
    right = {m: sum(tried[m].right for tried in cases.values()) for m in COMPETING}
    false = {m: sum(tried[m].false for tried in cases.values()) for m in COMPETING}
    for method in COMPETING:
        _lead(table, f"right names: {TITLES[method]}", method, right, f"of {hidden}", "most of all", max)
    for method in COMPETING:
        nulls = sum(tried[method].false for tried in cases.values() if not _hidden(tried))
        name, unit = f"false names: {TITLES[method]}", f"claims, {nulls} of them where nothing is hidden"
        _lead(table, name, method, false, unit, "fewest", min)


def _times(table: ResultTable, cases: Cases) -> None:
    medians = {m: statistics.median(tried[m].seconds for tried in cases.values()) for m in COMPETING}
    for method in COMPETING:
        _lead(table, f"processor time, median: {TITLES[method]}", method, medians, "s", "smallest of all", min)
    for method in COMPETING:
        ended = sum(bool(tried[method].ended) for tried in cases.values())
        table.add(f"cases without an answer: {TITLES[method]}", ended, unit=f"of {len(cases)}")


def _lead(
    table: ResultTable,
    name: str,
    method: str,
    values: Mapping[str, float],
    unit: str,
    goal: str,
    best: Callable[..., float],
) -> None:
    """A row; ours is to be the best of those that compete."""
    if method != "ours":
        table.add(name, values[method], unit=unit)
        return
    competing = [value for other, value in values.items() if other != "base"]
    table.add(name, values[method], unit=unit, goal=goal, holds=values[method] == best(competing))


def _cost(table: ResultTable, found: Sequence[Outcome]) -> None:
    ratios = [o.reference / o.seconds for o in found if o.reference is not None]
    if ratios:
        name = "the same parameters and starts, windows and tolerance: time of mujoco.sysid over ours, median"
        spread, middle = f"{min(ratios):.3g} to {max(ratios):.3g}", statistics.median(ratios)
        table.add(name, middle, spread=spread, unit="times", goal="at least 3", holds=middle >= FASTER)


def _case(table: ResultTable, name: str, tried: Mapping[str, Outcome]) -> None:
    errors = ", ".join(f"{method} {error_of(tried[method]):.3g}" for method in METHODS)
    said = "; ".join(f"{method}: {_said(tried[method])}" for method in COMPETING)
    table.add(name, ", ".join(_hidden(tried)) or "nothing", spread=errors, unit=said)


def _said(outcome: Outcome) -> str:
    return outcome.ended or ", ".join(outcome.claims) or "nothing"
