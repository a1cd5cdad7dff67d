"""What is wrong with a model, from its logs: the whole path from a problem to the hypothesis that explains them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.hypotheses.additions import AddedEffect, Addition, FreedNumber
from onlinebayes.criticism.hypotheses.discretisation import Discretisation
from onlinebayes.criticism.hypotheses.evaluating import Evaluation, Evaluator
from onlinebayes.criticism.hypotheses.held_out import held_out_errors
from onlinebayes.criticism.hypotheses.hypothesis import Hypothesis, values_of
from onlinebayes.criticism.hypotheses.lengths import fit_base
from onlinebayes.criticism.hypotheses.search import Round, Search
from onlinebayes.identification.data.noise import measured_floors
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.closed_loops import completed
from onlinebayes.identification.replaying.charted import charted
from onlinebayes.identification.replaying.clock import in_step
from onlinebayes.identification.replaying.scoped import scoped
from onlinebayes.identification.scope import Scope
from onlinebayes.identification.splitting import split
from onlinebayes.measurements import Measurement
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Effect
from onlinebayes.simulators.identifiable import Identifiable

PER_RUN = ("sensor_bias",)
"""Effects that are also tried with one size a run: an encoder finds another zero each time it is switched on."""


SCALES_HORIZON = 2.0
"""Seconds of the windows from which effects take their bounds: dead times up to a tenth of that are tried."""


@dataclass(frozen=True)
class Explanation:
    """What explains the logs.

    Args:
        base, found: the model as it is, and the hypothesis of which no neighbour is preferred.
        rounds: of the search.
        windows, discretisation: on which, and integrated how, it was judged.
        before, after: RMS of each signal over runs that were not fitted [its unit]; empty where none was held out.
        seconds: of the processor.
    """

    base: Evaluation
    found: Evaluation
    rounds: tuple[Round, ...]
    windows: Windows
    discretisation: Discretisation
    before: dict[str, float]
    after: dict[str, float]
    seconds: float


def explain(
    simulator: Identifiable,
    measurement: Measurement,
    *,
    holdout: Sequence[str] | None = None,
    candidates: str | Sequence[str | Effect] = "all",
    scope: Scope | None = None,
    watch: Callable[[str], None] = lambda _: None,
) -> Explanation:
    """Search for what is missing in a model, or off in it.

    Args:
        simulator: the model with its free parameters.
        measurement: all runs.
        holdout: names of the runs that are kept from the fit; chosen when None.
        candidates: ``"all"``, or names, ``name@target`` keys and effects with bounds of their own.
        scope: which parameters differ between runs.
        watch: told what is being done.

    Raises:
        BadInput: the model and the measurement do not fit together.
    """
    began = time.process_time()
    measurement, _ = completed(simulator, measurement.seen())
    given, measurement = charted(simulator, measurement)
    fit_runs, held_runs = split(measurement, holdout)
    given = scoped(in_step(given, fit_runs), scope, measurement, fit_runs.runs)
    watch("choosing the windows")
    begun = fit_base(given, fit_runs, measured_floors(fit_runs))
    evaluator = Evaluator(given, begun.windows, fit_runs.runs, begun.discretisation, watch)
    base = evaluator.evaluate(
        Hypothesis(), [values_of(begun.fitted.simulator, begun.fitted.theta)], begun.fitted.lin.starts
    )
    if base is None:
        raise BadInput("the model cannot follow the measurement", "check the model, its time step and its bounds")
    # A valley that shorter windows led into need not be the deepest.
    base = evaluator.evaluate(Hypothesis(), [{}]) or base
    search = Search(evaluator, base, additions(given, fit_runs, candidates))
    search.base = search.refined(base)
    found = search.run()
    watch("replaying the runs that were held out")
    before, after = (
        held_out_errors(search.evaluator, evaluation, held_runs) if held_runs.runs else {}
        for evaluation in (search.base, found)
    )
    return Explanation(
        search.base,
        found,
        tuple(search.rounds),
        search.evaluator.windows,
        search.evaluator.discretisation,
        before,
        after,
        time.process_time() - began,
    )


def additions(
    simulator: Identifiable, measurement: Measurement, wanted: str | Sequence[str | Effect] = "all"
) -> tuple[Addition, ...]:
    """Everything that is tried; a law that is the exact sum of others is tried as these."""
    windows = make_windows(simulator, measurement, SCALES_HORIZON)
    effects = [effect for effect in propose(simulator, windows, wanted) if not effect.sum_of]
    found: list[Addition] = [AddedEffect(effect) for effect in effects]
    if wanted != "all":
        return tuple(found)
    if len(windows.runs) > 1:
        found += [AddedEffect(effect, per_run=True) for effect in effects if effect.name in PER_RUN]
    found += [FreedNumber(address, bounds) for address, bounds in simulator.own_numbers.items()]
    return tuple(found)
