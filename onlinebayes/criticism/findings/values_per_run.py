"""The parameters that were found to differ between runs, with their values, and what declares them so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from onlinebayes.criticism.hypotheses.additions import OwnValues
from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.hypotheses.rounds import Round
from onlinebayes.criticism.results import ParameterChange
from onlinebayes.identification.replaying.scoped import unscoped
from onlinebayes.identification.results import Estimate
from onlinebayes.identification.scope import address_of
from onlinebayes.parameters import Parameter
from onlinebayes.simulators.mujoco.addresses import is_glob


def parameter_changes(explanation: Explanation, fitted: Mapping[str, Estimate]) -> tuple[ParameterChange, ...]:
    """One for each.

    Args:
        explanation: what was found.
        fitted: the final model's parameters.
    """
    return tuple(_change(explanation, one, *of, fitted) for one, of in _kept(explanation))


def _kept(explanation: Explanation) -> Iterator[tuple[Round, tuple[str, float]]]:
    for one in explanation.rounds:
        added = None if one.added is None else one.added.addition
        if isinstance(added, OwnValues) and added in explanation.found.hypothesis.additions:
            yield one, (added.address, explanation.base.values[added.address])


def _change(
    explanation: Explanation, one: Round, address: str, shared: float, fitted: Mapping[str, Estimate]
) -> ParameterChange:
    assert one.added is not None
    values = {
        name.removeprefix(f"{address}[run ").removesuffix("]"): value
        for name, value in fitted.items()
        if name != address and address_of(name) == address
    }
    bounds = unscoped(explanation.evaluator.given).parameters[address]
    before, after = (float(each.left_out[0].rms.square().mean().sqrt()) for each in (one.begun, one.added.evaluation))
    first = one.added.gains[0]
    return ParameterChange(
        address,
        values,
        shared,
        None,
        first.gain,
        first.se,
        first.folds,
        (1 - after / before,) * 2,
        tuple(other.address for other in one.equals if isinstance(other, OwnValues)),
        f'[parameters]\n"{address}" = {{ {_declared(address, bounds)}, scope = "per_run" }}',
    )


def _declared(address: str, bounds: Parameter) -> str:
    """Bounds as a problem file has them."""
    scale = "" if bounds.scale == "linear" else f', scale = "{bounds.scale}"'
    return f"low = {bounds.low:g}, high = {bounds.high:g}{scale}{', tie = true' if is_glob(address) else ''}"
