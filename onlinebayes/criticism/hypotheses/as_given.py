"""The model run as a simulator that wrote the log would have run it, where the log follows that far better.

    squared error above the noise, run so  <=  half of what the judged way leaves                  then it is run so

Models are integrated finely enough that no law is blamed for what an integrator does, and dry friction sticks. A log
that a simulator wrote has that simulator's own step, its soft friction and its moments of inertia: there the model is
right as it is, and a better integrator errs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from onlinebayes.criticism.hypotheses.discretisation import Discretisation
from onlinebayes.criticism.hypotheses.evaluating import Evaluation, Evaluator
from onlinebayes.criticism.hypotheses.rule import halves
from onlinebayes.identification.replaying.ladder import Rung
from onlinebayes.simulators.identifiable import Identifiable


def run_as_given(evaluator: Evaluator, here: Evaluation) -> tuple[Evaluator, Evaluation] | None:
    """The same hypothesis run as a simulator would, and what fits so; None where the log does not follow that.

    Args:
        evaluator, here: the hypothesis as it is judged; it leaves more than noise.
    """
    found = []
    for rung in _ways(evaluator.given, evaluator.discretisation.values):
        other = replace(evaluator, discretisation=Discretisation(rung, rung), known={}, as_given=True)
        evaluation = other.evaluate(here.hypothesis, [here.values], here.fitted.lin.starts)
        if evaluation is not None and halves(*(one.left[0].rms.tolist() for one in (here, evaluation))):
            found.append((other, evaluation))
    return min(found, key=lambda one: one[1].fitted.score) if found else None


def _ways(given: Identifiable, judged: Rung) -> Iterator[Rung]:
    """Its own step, with soft friction where it has dry one; and denser bodies where a mass is free."""
    own = Rung(given.timestep)
    if own != judged:
        yield own
    if given.with_soft_friction() is not given:
        yield replace(own, soft_friction=True)
    if given.with_scaled_moments() is not given:
        yield replace(judged, scaled_moments=True)
