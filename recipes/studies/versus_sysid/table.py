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
from collections.abc import Callable, Iterator, Mapping, Sequence

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
Figure = tuple[str, Mapping[str, float], str, str, Callable[..., float]]
"""Name, value of each method, unit, goal in words, and which of those that compete ours is to be."""


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
    for name, values, unit, goal, best in _figures(cases) if cases else ():
        for method, value in values.items():
            if method == "ours" and goal:
                holds = value == best(values[other] for other in COMPETING)
                table.add(f"{name}: {TITLES[method]}", value, unit=unit, goal=goal, holds=holds)
            else:
                table.add(f"{name}: {TITLES[method]}", value, unit=unit)
    _cost(table, [outcome for outcome in found if outcome.method == COST])
    for name, tried in cases.items():
        _case(table, name, tried)
    return table


def error_of(outcome: Outcome) -> float:
    """Held-out error [floors]; inf without an answer."""
    return math.inf if outcome.error is None else outcome.error


def _hidden(tried: Mapping[str, Outcome]) -> tuple[str, ...]:
    return next((outcome.hidden for outcome in tried.values() if outcome.hidden), ())


def _figures(cases: Cases) -> Iterator[Figure]:
    each, count = list(cases.values()), f"of {len(cases)}"
    errors = {method: [error_of(tried[method]) for tried in each] for method in METHODS}
    yield "held-out error, median", {m: statistics.median(errors[m]) for m in METHODS}, "floors", "smallest of all", min
    best = [min(values) for values in zip(*(errors[method] for method in COMPETING), strict=True)]
    wins = {m: sum(e <= CLOSE * b for e, b in zip(errors[m], best, strict=True)) for m in COMPETING}
    yield "smallest error, within 2 %", wins, count, "most of all", max
    hidden = sum(len(_hidden(tried)) for tried in each)
    right = {m: sum(tried[m].right for tried in each) for m in COMPETING}
    yield "right names", right, f"of {hidden}", "most of all", max
    yield "false names", {m: sum(tried[m].false for tried in each) for m in COMPETING}, "claims", "fewest", min
    nothing = {m: sum(tried[m].false for tried in each if not _hidden(tried)) for m in COMPETING}
    yield "false names where nothing is hidden", nothing, "claims", "fewest", min
    seconds = {m: statistics.median(tried[m].seconds for tried in each) for m in COMPETING}
    yield "processor time, median", seconds, "s", "smallest of all", min
    yield "cases without an answer", {m: sum(bool(t[m].ended) for t in each) for m in COMPETING}, count, "", min


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
