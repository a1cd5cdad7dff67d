"""The fit that an answer stands on, kept for the next command on the same model and log, which then fits nothing.

``refine`` judges its hypotheses as additions to the base model. ``posterior`` on the problem file that it wrote has
these in the model itself: another question to the evaluator, though the fit is the same. It is therefore kept once
more under the model that it is of, with the windows and the integration that it asked for.
"""

from __future__ import annotations

import json
from dataclasses import replace

import torch

from onlinebayes.criticism.hypotheses.explanation import Explanation
from onlinebayes.identification.data.windows import Windows
from onlinebayes.identification.fitting.discretisation import Discretisation
from onlinebayes.identification.fitting.gauss_newton import weighed
from onlinebayes.identification.fitting.sensitivities import Linearisation
from onlinebayes.identification.fitting.window_length import all_windows, thinned
from onlinebayes.identification.judging.evaluator import Evaluation, Evaluator
from onlinebayes.identification.judging.hypothesis import Hypothesis, build
from onlinebayes.identification.judging.scoring import LinearModel, left_out
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.measurements import Measurement
from onlinebayes.runs import Memo, NoDigest, NoMemo, digest
from onlinebayes.simulators.identifiable import Identifiable


def keep_fits(explanation: Explanation, fit_runs: Measurement) -> None:
    """Keep the fits of what was found and of its rivals, each under the simulator that its hypothesis makes.

    Args:
        explanation: whose evaluator has the memo.
        fit_runs: the runs.
    """
    for evaluation in (explanation.found, *explanation.rivals):
        _keep(evaluation, explanation.evaluator, fit_runs)


def _keep(evaluation: Evaluation, evaluator: Evaluator, fit_runs: Measurement) -> None:
    windows, ways = evaluator.windows, evaluator.discretisation
    key = _key(build(evaluator.given, evaluation.hypothesis, evaluator.runs), fit_runs)
    if key is None or isinstance(evaluator.memo, NoMemo):
        return
    told = {
        "horizon": windows.horizon,
        "windows": digest(windows),
        "original_integrator": evaluator.original_integrator,
        **{name: vars(way) for name, way in vars(ways).items()},
    }
    kept = evaluation.fitted.lin.kept
    tensors = {**kept.tensors, "noise": windows.noise, "count": torch.tensor(windows.count)}
    evaluator.memo.keep(key, replace(kept, tensors=tensors, text=json.dumps(told)))


def kept_fit(given: Identifiable, fit_runs: Measurement, memo: Memo) -> Explanation | None:
    """The explanation that a model as it is needs, where a command before has fitted it to these runs.

    Args:
        given: the model, ready for the log.
        fit_runs: the runs.
        memo: of the commands.

    Returns:
        Base and found are the same evaluation, over all windows; None where nothing was kept.
    """
    model = build(given, Hypothesis(), fit_runs.runs)
    key = _key(model, fit_runs)
    found = None if key is None else memo.recall(key)
    if found is None:
        return None
    told, tensors = json.loads(found.text), dict(found.tensors)
    noise, count = tensors.pop("noise"), int(tensors.pop("count"))
    windows = _windows(given, fit_runs, told["horizon"], noise, count)
    if digest(windows) != told["windows"]:
        return None
    ways = Discretisation(Integration(**told["values"]), Integration(**told["derivatives"]))
    evaluator = Evaluator(
        given, windows, fit_runs.runs, ways, original_integrator=told["original_integrator"], memo=memo
    )
    lin = Linearisation.of(replace(found, tensors=tensors))
    fitted = weighed(ways.values.of(model), ways.derivatives.of(model), windows, lin)
    linear = LinearModel.of(fitted)
    left = tuple(left_out(linear, windows, one) for one in evaluator.partitions)
    evaluation = Evaluation(Hypothesis(), fitted, left)
    return Explanation(evaluation, evaluation, (), evaluator)


def _key(model: Identifiable, fit_runs: Measurement) -> str | None:
    try:
        return digest("the fit of an answer", model, fit_runs)
    except NoDigest:
        return None


def _windows(given: Identifiable, fit_runs: Measurement, horizon: float, noise: torch.Tensor, count: int) -> Windows:
    """So many windows of one length: all of them, or thinned evenly."""
    return thinned(all_windows(given, fit_runs, horizon, noise), count)
