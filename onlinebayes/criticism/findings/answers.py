"""What is wrong but no effect, as the report has it: changes between runs, bounds that exclude the truth, faults."""

from __future__ import annotations

from collections.abc import Mapping

from onlinebayes.criticism.findings.like_runs import globs, like_runs
from onlinebayes.criticism.results import ParameterChange, WidenedBounds, Wiring
from onlinebayes.criticism.searching.search import SearchResult
from onlinebayes.criticism.wiring.wiring import Suspicion
from onlinebayes.identification.replaying.scoped import unscoped
from onlinebayes.identification.results import Estimate
from onlinebayes.identification.scope import address_of
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.mujoco.addresses import is_glob


def parameter_changes(found: SearchResult, fitted: Mapping[str, Estimate]) -> tuple[ParameterChange, ...]:
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
        groups = like_runs(values)
        if named := globs(groups):
            above = ", ".join(f'"{glob}"' for glob in named)
            lines = f"groups = [{above}]  # above the first [table]\n{lines}"
        shared = float(base.theta[base.simulator.parameters.index(address)])
        gain = one.gain
        rows.append(
            ParameterChange(
                address,
                values,
                shared,
                one.p_value,
                gain.gain,
                gain.se,
                gain.blocks,
                one.falls,
                change.equals,
                lines,
                groups,
            )
        )
    return tuple(rows)


def _declared(address: str, bounds: Parameter) -> str:
    """Bounds as a problem file has them."""
    scale = "" if bounds.scale == "linear" else f', scale = "{bounds.scale}"'
    return f"low = {bounds.low:g}, high = {bounds.high:g}{scale}{', tie = true' if is_glob(address) else ''}"


def widened_bounds(found: SearchResult, fitted: Mapping[str, Estimate]) -> dict[str, WidenedBounds]:
    """The bound that excludes the truth, by parameter, as it was and as it would have to be.

    Args:
        found: what the search found.
        fitted: the final model's parameters.
    """
    wide = found.widened
    if wide is None:
        return {}
    after = proposed_bounds(wide.before, wide.after, fitted[wide.name])
    return {wide.name: WidenedBounds((wide.before.low, wide.before.high), after)}


def proposed_bounds(before: Parameter, tried: Parameter, value: Estimate) -> tuple[float, float]:
    """Bounds that hold what the data ask for well inside and are of its order, to two digits.

    Args:
        before: as they were.
        tried: with one of them ten ranges away.
        value: what the data ask for.
    """
    if tried.high > before.high:
        return before.low, _two_digits(_well_beyond(value.mean, value.sd))
    low = _two_digits(-_well_beyond(-value.mean, value.sd))
    return (max(low, tried.low) if before.low > 0 else low), before.high  # a mass is never negative


def _well_beyond(value: float, sd: float) -> float:
    """Twice the value, half of a negative one; ten sd above it at least."""
    return max(2 * value if value > 0 else value / 2, value + 10 * sd)


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def wiring_of(suspicion: Suspicion) -> Wiring:
    """The fault, the lines that mend it, and those that would do as well."""
    fault, equals = suspicion.fault, tuple((equal.says, equal.lines) for equal in suspicion.equals)
    return Wiring(fault.says, fault.lines, suspicion.before, suspicion.left, equals)
