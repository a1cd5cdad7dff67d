"""The model run as a simulator that wrote the log would have run it, where the log follows that far better.

    squared error above the noise, run so  <=  half of what the judged way leaves
    gain in left-out score  >=  0.05, and > 2 se                                                   then it is run so

Models are integrated finely enough that no law is blamed for what an integrator does, and dry friction sticks. A log
that a simulator wrote has that simulator's own step, its soft friction and its moments of inertia: there the model is
right as it is, and a better integrator errs. Most engines step by a method of first order, whatever the model's file
asks for. What such a step errs by may be within the noise and still move every parameter, so that it is asked of a
model that leaves little more than noise, too. Moments that follow the masses are no integrator but a guess about the
bodies: they are believed only where no more than noise is left, for a rotor's inertia that is off looks like them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from onlinebayes.identification.fitting.discretisation import Discretisation
from onlinebayes.identification.judging.evaluator import (
    FIRST_STEPS,
    Evaluation,
    Evaluator,
    FitRequest,
    at_noise_floor,
)
from onlinebayes.identification.judging.rule import LEAST_GAIN, STANDARD_ERRORS, explains_half
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.runs import side_by_side
from onlinebayes.simulators.abilities import Integrated


def with_original_integrator(evaluator: Evaluator, here: Evaluation) -> tuple[Evaluator, Evaluation] | None:
    """The same hypothesis run as a simulator would, and what fits so; None where the log does not follow that.

    Args:
        evaluator, here: the hypothesis as it is judged.
    """
    if _above_noise(here) < LEAST_GAIN:
        return None
    ways = [Discretisation(way, way) for way in _ways(evaluator.given, evaluator.discretisation.values)]
    others = [replace(evaluator, discretisation=way, original_integrator=True) for way in ways]
    found = side_by_side([partial(_followed, other, here) for other in others])
    best = [(other, one) for other, one in zip(others, found, strict=True) if one is not None]
    return min(best, key=lambda one: one[1].fitted.score, default=None)


def _followed(other: Evaluator, here: Evaluation) -> Evaluation | None:
    """The same hypothesis integrated otherwise, where that is far better."""
    wanted, starts = here.fitted.score - LEAST_GAIN, here.fitted.lin.starts
    begun = other.evaluate(FitRequest(here.hypothesis, [here.values], starts, most=FIRST_STEPS, wanted=wanted))
    if begun is None or begun.fitted.score > wanted:
        return None  # a model that is right in this way needs no long walk
    evaluation = other.anew(begun)
    if evaluation is None or (other.discretisation.values.scaled_moments and not at_noise_floor(evaluation)):
        return None  # denser bodies are no integrator: a rotor's inertia that is off would be taken for them
    return evaluation if _far_better(evaluation, here) else None


def _above_noise(here: Evaluation) -> float:
    """Return the most that any way could gain: the score above that of noise alone [nats]."""
    return float(((1 + here.left_out[0].rms.square()) / 2).log().clamp_min(0.0).sum()) / 2


def _far_better(other: Evaluation, here: Evaluation) -> bool:
    gained = other.gains(here)[0]
    certain = gained.gain >= max(LEAST_GAIN, STANDARD_ERRORS * gained.se)
    return certain and explains_half(here.left_out[0], other.left_out[0])


def _ways(given: Integrated, judged: Integration) -> Iterator[Integration]:
    """Its own step, also by a method of first order; soft friction where it has dry one; denser bodies."""
    own = Integration(given.timestep)
    if own != judged:
        yield own
    if given.with_first_order() is not given:
        yield replace(own, method="first_order")
    if given.with_soft_friction() is not given:
        yield replace(own, soft_friction=True)
    if given.with_scaled_moments() is not given:
        yield replace(judged, scaled_moments=True)
