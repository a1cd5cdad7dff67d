"""What a check says, as labelled sentences: what changed, since when, how sure, and the error then and now."""

from __future__ import annotations

import math

from onlinebayes.criticism import FALSE_ALARMS, Change, Check
from onlinebayes.identification import quantities
from onlinebayes.report.phrases import plain

LEAST_P = 1e-6
"""A smaller probability is no better known than this one: the tails are those of a model."""


def lines(found: Check) -> list[tuple[str, str]]:
    """(label, sentence), the verdict first; at most nine."""
    told = [("verdict", f"{found.verdict}: {headline(found)}")]
    for change in found.changes:
        told.append(("change", f"{size(change)}, {since(change)}"))
        told.append(("sure", sure(change)))
    if found.changes and found.changes[0].alike:
        told.append(("or", f"{', '.join(found.changes[0].alike[:3])} would explain as much"))
    told.append(("error", error(found)))
    return told


def headline(found: Check) -> str:
    """One sentence."""
    if found.changes:
        return "the machine is no longer as the model has it: " + " and ".join(named(one) for one in found.changes)
    if found.verdict == "changed":
        return "the model's error rose, and no change of one number explains it; refine on the new logs"
    return f"the model still holds in {_runs(len(found.new_runs))}"


def named(change: Change) -> str:
    """``dry friction at rail is 1.2 times as large``, ``the zero of qpos.hinge moved by 3°``."""
    name, _, target = change.key.partition("@")
    if name == "sensor_bias":
        moved = change.after - change.before
        angle = f" ({math.degrees(moved):.2g}°)" if change.unit == "rad" else ""
        signal = target.rpartition(".")[0]
        return f"the zero of {signal} moved by {quantities.text(moved, change.unit, 3)}{angle}"
    what = plain(change.key.rpartition(".")[0]) if "@" in change.key else change.key
    if change.before > 0:
        return f"{what} is {quantities.significant(change.after / change.before, 3)} times as large"
    return f"{what} came to {quantities.text(change.after, change.unit, 3)}"


def size(change: Change) -> str:
    """``joint.rail.damping 1.4 to 1.6 N s/m (1.57 to 1.61, 90 %)``."""
    values = (change.before, change.after, change.low, change.high)
    scale = quantities.shared_scale([value for value in values if value], change.unit)
    before, after, low, high = (scale.number(value, 3) for value in values)
    ratio = ""
    if change.before > 0 and change.low > 0:
        ends = (quantities.significant(end / change.before, 3) for end in (change.low, change.high))
        ratio = f", {' to '.join(ends)} times"
    return f"{change.key} {before} → {after} {scale.unit} ({low} to {high}{ratio}; 90 %)"


def since(change: Change) -> str:
    """``since before these logs``, ``since run n3``, ``since 4.8 s of run n0 at the latest``."""
    if change.since.first:
        return f"in all of the new logs, from run {change.since.run} on"
    if change.since.time is None:
        return f"since run {change.since.run}"
    return f"since {change.since.time:.3g} s of run {change.since.run} at the latest"


def sure(change: Change) -> str:
    """The chance of a false alarm as large."""
    p = f"less than {LEAST_P:g}" if change.p < LEAST_P else f"{change.p:.2g}"
    return f"an unchanged machine shows this with probability {p}"


def error(found: Check) -> str:
    """``qpos.rail 1 mm then, 1.6 mm now``, of the signal that rose most."""
    rise = {name: now / max(found.error.reference[name], 1e-300) for name, now in found.error.now.items()}
    name = max(rise, key=lambda one: rise[one])
    unit = found.units.get(name, "")
    then, now = (quantities.text(one[name], unit) for one in (found.error.reference, found.error.now))
    besides = ""
    if found.changes:
        besides = (
            "; without what changed as before" if found.error.p >= FALSE_ALARMS / 2 else "; more than that changed"
        )
    return f"{name} {then} in the reference, {now} now{besides}"


def _runs(count: int) -> str:
    return f"{count} new run{'' if count == 1 else 's'}"
