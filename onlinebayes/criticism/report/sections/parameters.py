"""The parameters of the final model with their intervals, beside the base model's own, and what the data leave open."""

from __future__ import annotations

from onlinebayes.criticism.report import quantities, words
from onlinebayes.criticism.report.markup import Html, join, section, table, tag
from onlinebayes.criticism.results import Criticism, Estimate, FlatDirection
from onlinebayes.parameters import Parameter


def render(result: Criticism) -> Html:
    """Parameter table and flat directions."""
    return join(_table(result), _flat(result))


def _table(result: Criticism) -> Html:
    space, changed, rows = dict(result.final.simulator.parameters), result.changed, []
    for name, value in result.parameters.items():
        base = result.base.parameters.get(name)
        bounds = space.get(name)
        cells = [
            tag("code", name),
            tag("strong", words.estimate(value)),
            interval_text(value),
            _strip(value, bounds) if bounds else "",
            _state(value, bounds),
        ]
        if changed:
            cells.insert(3, words.estimate(base) if base else "–")
        rows.append(cells)
    head = ["parameter", "value", "90 % interval", "within its bounds", ""]
    if changed:
        head.insert(3, "without the effects")
    note = "Mean ± standard deviation, from leaving one block of data out at a time."
    return section("Parameters", table(head, rows), note=note) if rows else Html("")


def interval_text(value: Estimate) -> str:
    """``92.6 to 97.4 kg``, in the unit that suits the mean."""
    scale = quantities.scale_for(max(abs(value.q05), abs(value.q95)), value.unit)
    return f"{scale.number(value.q05, 3)} to {scale.text(value.q95, 3)}"


def _state(value: Estimate, bounds: Parameter | None) -> str:
    if not value.identifiable:
        return "not determined alone"
    if bounds is not None and min(value.mean - bounds.low, bounds.high - value.mean) < 1e-3 * (
        bounds.high - bounds.low
    ):
        return "at its bound"
    return ""


def _strip(value: Estimate, bounds: Parameter) -> Html:
    """The 90 % interval and the mean, drawn within the bounds."""
    width = bounds.high - bounds.low
    low, high, mean = (100 * min(max((x - bounds.low) / width, 0), 1) for x in (value.q05, value.q95, value.mean))
    ends = f"{bounds.low:.4g} to {bounds.high:.4g} {quantities.scale_for(0.0, bounds.unit).unit}".strip()
    return Html(
        f'<span class="strip" title="{ends}"><i style="left:{low:.1f}%;width:{max(high - low, 1):.1f}%"></i>'
        f'<b style="left:{mean:.1f}%"></b></span><small>{ends}</small>'
    )


def _flat(result: Criticism) -> Html:
    if not result.flat_directions:
        return Html("")
    rows = [(direction.description, _components(direction)) for direction in result.flat_directions]
    note = (
        "These combinations can change with no visible change of the trajectories. Do not read the intervals of the "
        "parameters named here one by one; fix one of them by a measurement of its own, such as a scale."
    )
    return section("What the data leave open", table(("in words", "direction"), rows), note=note)


def _components(direction: FlatDirection) -> Html:
    largest = sorted(direction.direction.items(), key=lambda item: -abs(item[1]))[:4]
    return tag("code", "  ".join(f"{value:+.2f} {name}" for name, value in largest))
