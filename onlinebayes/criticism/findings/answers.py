"""What is wrong but no effect, as the report has it: changes between runs, bounds that exclude the truth, faults."""

from __future__ import annotations

from collections.abc import Mapping

from onlinebayes.criticism.replaying.scoped import unscoped
from onlinebayes.criticism.results import Estimate, ParameterChange, WidenedBounds, Wiring
from onlinebayes.criticism.scope import address_of
from onlinebayes.criticism.searching.search import Found
from onlinebayes.criticism.wiring.wiring import Suspicion
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.mujoco.addresses import is_glob


def parameter_changes(found: Found, fitted: Mapping[str, Estimate]) -> tuple[ParameterChange, ...]:
    """The parameters that differ between runs, with their values in the final model.

    Args:
        found: what the search found.
        fitted: the final model's parameters.
    """
    rows = []
    for change in found.changes:
        one, base = change.judged, found.base.fitted
        space, address = unscoped(change.simulator).parameters, one.address
        bounds = space[address]
        values = {
            name.removeprefix(f"{address}[run ").removesuffix("]"): value
            for name, value in fitted.items()
            if name != address and address_of(name) == address
        }
        lines = f'[parameters]\n"{address}" = {{ {_declared(address, bounds)}, scope = "per_run" }}'
        shared = float(base.theta[base.simulator.parameters.index(address)])
        gain = one.gain
        rows.append(
            ParameterChange(
                address, values, shared, one.p_value, gain.gain, gain.se, gain.blocks, one.falls, change.equals, lines
            )
        )
    return tuple(rows)


def _declared(address: str, bounds: Parameter) -> str:
    """Bounds as a problem file has them."""
    scale = "" if bounds.scale == "linear" else f', scale = "{bounds.scale}"'
    return f"low = {bounds.low:g}, high = {bounds.high:g}{scale}{', tie = true' if is_glob(address) else ''}"


def widened_bounds(found: Found) -> dict[str, WidenedBounds]:
    """The bound that excludes the truth, by parameter, as it was and as it would have to be."""
    wide = found.widened
    if wide is None:
        return {}
    return {wide.name: WidenedBounds((wide.before.low, wide.before.high), (wide.after.low, wide.after.high))}


def wiring_of(suspicion: Suspicion) -> Wiring:
    """The fault, the lines that mend it, and those that would do as well."""
    fault, equals = suspicion.fault, tuple((equal.says, equal.lines) for equal in suspicion.equals)
    return Wiring(fault.says, fault.lines, suspicion.before, suspicion.left, equals)
