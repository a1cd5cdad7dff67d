"""Notes on an answer beside its numbers: how it was integrated, values on bounds, laws that add up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.criticism.results import WeightedModel
from onlinebayes.identification import quantities
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.results import Estimate, Numerics
from onlinebayes.parameters import ParameterSpace
from onlinebayes.simulators.effects import EFFECTS, Effect

TOLD = 3
"""Hypotheses whose weights are told each."""


def notes_on(explanation: Explanation, numerics: Numerics, fitted: Mapping[str, Estimate]) -> tuple[str, ...]:
    """A sentence for each such thing.

    Args:
        explanation: what the fit runs say.
        numerics: of the final model.
        fitted: its parameters.
    """
    found, evaluator = explanation.found, explanation.evaluator
    simulator = found.fitted.simulator
    return (
        *_of_the_step(found, evaluator, numerics),
        *_of_bounds(simulator.parameters, fitted),
        *_of_sums(simulator.effects),
    )


def weights(hypotheses: Sequence[WeightedModel]) -> Iterator[str]:
    """Say how far each of several hypotheses is to be believed, the likeliest first."""
    if len(hypotheses) > 1:
        ordered = sorted(hypotheses, key=lambda one: -one.weight)
        told = [f"{' + '.join(one.accepted)} {quantities.percent(one.weight)}" for one in ordered[:TOLD]]
        rest = sum(one.weight for one in ordered[TOLD:])
        told += [f"{len(ordered) - TOLD} others {quantities.percent(rest)} together"] if rest else []
        yield f"how far each model that the data leave open is to be believed: {', '.join(told)}"


def _of_the_step(found: Evaluation, evaluator: Evaluator, numerics: Numerics) -> Iterator[str]:
    way, given = evaluator.discretisation.values, evaluator.given
    if not numerics.sufficient:
        yield (
            f"numerics: in steps of {way.timestep:g} s the integration error is no small part of what is left: sizes "
            "of what is named carry it; give the model a shorter time step or a better integrator"
        )
    elif evaluator.original_integrator and not way.scaled_moments:
        yield (
            f"numerics: {way.told} in steps of {way.timestep:g} s follows the log far better than a finer "
            "one, as if a simulator had written it; it was judged in these steps"
        )
    elif way.method in ("runge_kutta", "extrapolated") or way.timestep < given.timestep:
        yield (
            f"numerics: the model was integrated by {way.told} in steps of {way.timestep:g} s; its own method in steps "
            f"of {given.timestep:g} s is not exact enough for these sensors"
        )
    if way.soft_friction:
        yield (
            "friction: the log follows MuJoCo's own soft friction, which creeps, far better than friction that sticks; "
            "the refined model keeps the soft one"
        )
    if way.scaled_moments:
        yield (
            "moments of inertia: the data ask for bodies that are denser or lighter throughout: where a mass is free, "
            "the moments follow it; body.NAME.inertia[i] in [parameters] frees them instead"
        )


def _of_bounds(space: ParameterSpace, fitted: Mapping[str, Estimate]) -> Iterator[str]:
    """A value of the model's own on its bound; zero as a lower one is where many laws end, and no surprise."""
    bounds = dict(space)
    for name, value in fitted.items():
        if value.at_bound is None or "@" in name or name not in bounds:
            continue
        end = bounds[name].low if value.at_bound == "low" else bounds[name].high
        if end != 0:
            yield (
                f"{name} ends on its bound of {quantities.exact(end, value.unit)}: the data may ask for more than was "
                "allowed, and all other values are as uncertain as it is"
            )


def _of_sums(accepted: Sequence[Effect]) -> Iterator[str]:
    """Of laws that are others together: the same force."""
    keys = {effect.key for effect in accepted}
    for element in dict.fromkeys(effect.element for effect in accepted):
        for kind in EFFECTS.values():
            whole, parts = f"{kind.name}@{element}", [f"{name}@{element}" for name in kind.sum_of]
            if parts and whole in keys:
                yield f"{whole} is by its equation {' and '.join(parts)} together: no record parts the two accounts"
            elif parts and keys.issuperset(parts):
                yield f"{' and '.join(parts)} are by their equation {whole}: no record parts the two accounts"
