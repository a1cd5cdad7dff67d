"""How well a model predicts single runs that it was not fitted to."""

from __future__ import annotations

import math

import pytest

from onlinebayes.criticism import run_scores
from onlinebayes.simulators.effects import ViscousFriction
from tests.criticism.rigs import FREE, TRUTH, measure, model

NOISE, RUNS = 1e-3, 3
TRUE = dict(zip(FREE.names, TRUTH, strict=True))


def test_a_run_is_predicted_down_to_its_noise_by_the_truth_and_by_nothing_else() -> None:
    runs = measure({}, runs=RUNS, noise=NOISE)
    floor = {signal.name: NOISE for signal in runs.signals}
    true = run_scores(model(), TRUE, runs, floor, 1.0)
    assert true.tolist() == pytest.approx([0.5 * math.log(2.0) * len(floor)] * RUNS, rel=0.2)
    heavy = run_scores(model(), {**TRUE, FREE.names[0]: 1.3 * TRUTH[0]}, runs, floor, 1.0)
    assert bool((heavy > true + 0.3).all())


def test_each_run_is_judged_alone() -> None:
    runs = measure({}, runs=RUNS, noise=NOISE)
    floor, wrong = {signal.name: NOISE for signal in runs.signals}, {**TRUE, FREE.names[1]: 0.0}
    together = run_scores(model(), wrong, runs, floor, 1.0)
    alone = [float(run_scores(model(), wrong, runs.select([run]), floor, 1.0)) for run in runs.runs]
    assert together.tolist() == pytest.approx(alone)


def test_an_effect_at_its_neutral_value_predicts_what_the_model_does() -> None:
    runs = measure({}, runs=1, noise=NOISE)
    floor = {signal.name: NOISE for signal in runs.signals}
    friction = ViscousFriction("rail", FREE[FREE.names[1]])
    grown = run_scores(model().with_effect(friction), {**TRUE, f"{friction.key}.damping": 0.0}, runs, floor, 1.0)
    assert grown.tolist() == pytest.approx(run_scores(model(), TRUE, runs, floor, 1.0).tolist())
