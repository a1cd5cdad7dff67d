"""Phrases that all sentences of a report are made of: names of effects, lists, estimates, comparisons."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from onlinebayes.identification import Estimate, Fleet, quantities
from onlinebayes.simulators.effects import EFFECTS

NOT_DETERMINED = "not determined"
"""In place of a value that may be anywhere within its bounds."""


def plain(effect: str) -> str:
    """``dry_friction@carriage`` -> ``dry friction at carriage``."""
    name, _, target = effect.partition("@")
    return f"{_spoken(name)} at {target}" if target else _spoken(name)


def _spoken(name: str) -> str:
    """``stribeck_friction`` -> ``Stribeck friction``; the address of a number stays as the model has it."""
    if "." in name:
        return name
    return name.replace("_", " ").replace("stribeck", "Stribeck").replace("back emf", "back-EMF")


def effects_in_words(effects: Sequence[str], last: str = "and") -> str:
    """``dry friction and constant load at carriage, actuator delay at left and right``, grouped by target."""
    by_target: dict[str, list[str]] = {}
    for effect in effects:
        name, _, target = effect.partition("@")
        by_target.setdefault(target, []).append(_spoken(name))
    by_names: dict[tuple[str, ...], list[str]] = {}
    for target, names in by_target.items():
        by_names.setdefault(tuple(names), []).append(target)
    groups = [
        f"{listing(names, last)}{f' at {listing(sorted(targets), last)}' if any(targets) else ''}"
        for names, targets in by_names.items()
    ]
    return f", {last} ".join(groups)


def meaning(effect: str) -> str:
    """Describe an effect of the vocabulary in one phrase from its own documentation; empty for others."""
    kind = EFFECTS.get(effect.partition("@")[0])
    first = (kind.__doc__ or "").strip().splitlines()[0] if kind else ""
    return re.split(r"[;.](?:\s|$)", first)[0]


def listing(items: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {last} {items[-1]}" if items else ""


def probability(p: float) -> str:
    """``0.87``; no more certain than its calibration can be: ``above 0.99``, ``below 0.01``."""
    return "above 0.99" if p > 0.99 else "below 0.01" if p < 0.01 else f"{p:.2f}"


def more(count: int, what: str) -> str:
    """``1 more run``, ``2 more runs``."""
    return f"{count} more {what}{'' if count == 1 else 's'}"


def capitalised(text: str) -> str:
    """The text with a capital at its beginning."""
    return text[:1].upper() + text[1:]


def estimate(value: Estimate) -> str:
    """``mean ± sd unit``; on an end of what was allowed ``at most``, or ``at least``; or that the data leave it open.

    What they leave open has a mean where the fit began.

    The interval is cut at the bounds, so that it is narrower than the sd only where both cut it.
    """
    if value.at_bound == "low":
        return f"at most {quantities.exact(float(f'{max(value.mean, value.q95):.3g}'), value.unit)}"
    if value.at_bound == "high":
        return f"at least {quantities.exact(float(f'{min(value.mean, value.q05):.3g}'), value.unit)}"
    if 0 < value.q95 - value.q05 < value.sd:
        return NOT_DETERMINED
    return quantities.with_error(value.mean, value.sd, value.unit)


def fleet(address: str, found: Fleet) -> str:
    """``joint.a.damping: 0.31 N m s/rad on average, spread 0.04, the next unit's 0.22 to 0.4 (90 %)``."""
    unit = found.mean.unit
    spread = quantities.text(found.spread.mean, unit) if found.spread.mean else "none seen"
    most = quantities.text(found.spread.q95, unit)
    gone = f" ({listing(found.left_out)} not determined)" if found.left_out else ""
    return (
        f"{address}: {quantities.text(found.mean.mean, unit, 3)} on average of {len(found.units)} units{gone}, spread "
        f"{spread} (at most {most}), the next unit's {interval(found.next)}"
    )


def interval(value: Estimate) -> str:
    """``92.6 to 97.4 kg``, in the unit that suits the mean."""
    return quantities.interval(value.q05, value.q95, value.unit)


def better(before: float, after: float) -> str:
    """``3.3 times better``, ``12 % better`` or ``no better``."""
    ratio = before / after if after > 0 else math.inf
    if ratio >= 1.5:
        return f"{quantities.times(ratio)} better"
    return f"{quantities.percent(1 - after / before)} better" if ratio > 1.005 else "no better"


def times_floor(ratio: float) -> str:
    """``33 times the noise floor``, or ``at the noise floor``."""
    if not math.isfinite(ratio):
        return "no noise floor is known"
    return "at the noise floor" if ratio <= 1.05 else f"{quantities.times(ratio)} the noise floor"
