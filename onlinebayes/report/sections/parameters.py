"""The parameters of the final model with their intervals, beside the base model's own, and what the data leave open."""

from __future__ import annotations

import math

from onlinebayes.criticism import Criticism
from onlinebayes.identification import Estimate, FlatDirection, address_of, quantities
from onlinebayes.parameters import Parameter
from onlinebayes.report import phrases, words
from onlinebayes.report.markup import Html, folded, join, section, table, tag, text

SHOWN = 16
WIDE = 0.8
"""Share of the bounds from which an interval says no more than they do."""


def render(result: Criticism) -> Html:
    """Parameter table, what units have in common, and flat directions."""
    return join(_table(result), _fleets(result), _flat(result))


def _table(result: Criticism) -> Html:
    space, changed, rows = dict(result.final.simulator.parameters), result.changed, []
    for name, value in result.parameters.items():
        base = result.base.parameters.get(name) or result.base.parameters.get(address_of(name))
        bounds = space.get(name)
        cells = [
            tag("code", name),
            tag("strong", phrases.estimate(value)),
            phrases.interval(value),
            strip(name, value, bounds, base if changed else None) if bounds else "–",
            _state(value, bounds, sound=result.remainder.status == "noise"),
        ]
        if changed:
            cells.insert(3, phrases.estimate(base) if base else "–")
        rows.append(cells)
    head = ["parameter", "value", "90 % interval", "within what was allowed", "known?"]
    if changed:
        head.insert(3, "without the effects" if result.accepted else "in the base model")
    beyond = "" if result.remainder.status == "noise" else f"The model leaves more than noise: {words.BEYOND}. "
    note = (
        f"{beyond}Mean ± standard deviation, from leaving one block of data out at a time. The grey bar is what was "
        "allowed before the data; the coloured part is the 90 % interval after them, the line the mean"
        + ("; the orange mark is the base model's own value." if changed else ".")
    )
    shown = table("Parameters of the final model", head, rows[:SHOWN])
    rest = rows[SHOWN:]
    more = folded(phrases.more(len(rest), "parameter"), table("The other parameters", head, rest)) if rest else ""
    return section("Values and intervals", shown, more, note=note) if rows else Html("")


def _fleets(result: Criticism) -> Html:
    """A table for each parameter that has one value in every unit."""
    if not result.fleet:
        return Html("")
    head = ["of", "value", "90 % interval"]
    tables = []
    for address, fleet in result.fleet.items():
        known = {
            "the mean of all units": fleet.mean,
            "the spread between units (sd)": fleet.spread,
            "the next unit": fleet.next,
            **{f"unit {name}": value for name, value in fleet.units.items()},
        }
        rows: list[tuple[str, str, str]] = [
            (what, tag("strong", _fleet_value(value)), phrases.interval(value)) for what, value in known.items()
        ]
        rows += [(f"unit {name}", "not determined", "not used") for name in fleet.left_out]
        tables.append(table(address, head, rows))
    note = (
        "The units' values are taken as drawn from one normal distribution; a unit's own is drawn towards the mean by "
        "as much as its error leaves open. The intervals count that few units say little of their spread. Each "
        "parameter is looked at alone. next_unit.json is the distribution of the next unit's, to load."
    )
    return section("From unit to unit", *tables, note=note)


def _fleet_value(value: Estimate) -> str:
    return quantities.text(value.mean, value.unit, 3) if value.mean else "none seen"


def _state(value: Estimate, bounds: Parameter | None, *, sound: bool) -> str:
    if value.at_bound:
        return "at its bound"
    if not value.identifiable:
        return "not determined alone"
    if not sound:
        return "in this model"
    if bounds is None:
        return "yes"
    share = (value.q95 - value.q05) / (bounds.high - bounds.low)
    return f"yes, to {quantities.percent(share)} of what was allowed" if share < WIDE else "hardly: the bounds decide"


def strip(name: str, value: Estimate, bounds: Parameter, base: Estimate | None) -> Html:
    """The 90 % interval and the mean, and the base model's mean, within the bounds on the parameter's own scale."""
    low, high, mean = (_place(x, bounds) for x in (value.q05, value.q95, value.mean))
    ends = f"{bounds.low:.4g} to {bounds.high:.4g} {quantities.scale_for(0.0, bounds.unit).unit}".strip()
    log = " (logarithmic)" if bounds.scale == "log" else ""
    label = text(f"{name}: {phrases.estimate(value)}, 90 % within {phrases.interval(value)}; allowed {ends}{log}")
    marks = f'<s style="left:{_place(base.mean, bounds):.1f}%"></s>' if base else ""
    marks += f'<u class="{value.at_bound}"></u>' if value.at_bound else ""
    return Html(
        f'<span class="strip" role="img" aria-label="{label}" title="{text(ends)}">'
        f'<i style="left:{low:.1f}%;width:{max(high - low, 1):.1f}%"></i><b style="left:{mean:.1f}%"></b>{marks}</span>'
        f"<small>{text(ends + log)}</small>"
    )


def _place(value: float, bounds: Parameter) -> float:
    """Return the place of a value between the bounds [%]."""
    low, high = bounds.low, bounds.high
    if bounds.scale == "log":
        low, high, value = math.log(low), math.log(high), math.log(max(value, low))
    return 100 * min(max((value - low) / (high - low), 0.0), 1.0)


def _flat(result: Criticism) -> Html:
    if not result.flat_directions:
        return Html("")
    rows = [(direction.description, _components(direction)) for direction in result.flat_directions]
    note = (
        "These combinations can change with no visible change of the trajectories. Do not read the intervals of the "
        "parameters named here one by one; fix one of them by a measurement of its own, such as a scale."
    )
    shown = table("Directions that the data leave flat", ("in words", "direction"), rows)
    return section("What the data leave open", shown, note=note)


def _components(direction: FlatDirection) -> Html:
    largest = sorted(direction.direction.items(), key=lambda item: -abs(item[1]))[:4]
    visible = [(name, value) for name, value in largest if abs(value) >= 0.005]  # the others would read 0.00
    if len(visible) == 1:
        return join(tag("code", visible[0][0]), " alone")
    return tag("code", "  ".join(f"{value:+.2f} {name}" for name, value in visible))
