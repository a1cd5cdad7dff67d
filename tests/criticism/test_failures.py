"""Whatever fails once the base model is fitted: the best answer so far is given, with a line on what failed."""

from __future__ import annotations

import pytest

from onlinebayes.criticism import Criticism, answer, commands, compare, refine
from onlinebayes.criticism.hypotheses import explanation
from onlinebayes.criticism.hypotheses.search import Search
from onlinebayes.identification.judging.evaluator import Evaluator
from onlinebayes.identification.judging.hypothesis import Hypothesis
from onlinebayes.simulators.effects import EFFECTS, Scales
from tests.criticism.rigs import measure, model

pytestmark = pytest.mark.usefixtures("faults_are_noted")
FRICTION = EFFECTS["dry_friction"].scaled("rail", Scales(1.0, 1.0, 4.0, 0.01, "slide"))
TABLE = measure({FRICTION: (1.5,)}, runs=5, seconds=1.0)
SHORT = measure({FRICTION: (1.5,)}, runs=3, seconds=0.5)


def fail(*_: object, **__: object) -> None:
    raise RuntimeError("the tensors differ")


def answer_of() -> Criticism:
    return refine(model(), TABLE, candidates=["dry_friction", "actuator_delay"])


def test_the_answer_stands_without_parts_of_the_work(
    monkeypatch: pytest.MonkeyPatch, without_shape_checks: None
) -> None:
    parts = {
        "checking signs, units and columns": (commands, "find_fault"),
        "fitting to all windows": (commands, "settled"),
        "the error over the held-out runs": (answer, "evaluate_held_out"),
        "weighing the models": (answer, "weighted"),
        "ranking the candidates": (answer, "ranked"),
        "looking at what is left": (answer, "failures"),
        "looking where the model fails": (answer, "failures"),
    }
    for module, name in parts.values():
        monkeypatch.setattr(module, name, fail)
    found = compare(model(), SHORT)
    assert found.verdict == "insufficient_data"
    assert found.parameters.keys() == {"body.cart.mass", "joint.rail.damping"}
    assert [run.run for run in found.final.replays] == ["run0", "run1", "run2"]
    for line, part in zip(found.failed, parts, strict=True):
        assert line.startswith(f"{part} failed by a fault of onlinebayes: RuntimeError: the tensors differ ")
        assert "(test_failures.py, line " in line
        assert line in found.notes


@pytest.mark.slow
def test_held_out_runs_that_cannot_be_replayed_leave_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    windows = answer.windows_to_replay

    def of_fit_runs(shown, runs, *more: object) -> object:
        return windows(shown, runs, *more) if "run0" in runs.runs else fail()

    monkeypatch.setattr(answer, "windows_to_replay", of_fit_runs)
    found = compare(model(), SHORT)
    assert found.held_out_runs == ()
    assert [run.run for run in found.final.replays] == ["run0", "run1"]
    assert found.failed[0].startswith("replaying all runs failed")


@pytest.mark.slow
def test_a_search_that_fails_in_its_second_round_keeps_what_the_first_one_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    once = Search.round

    def round_(search: Search, here: object) -> object:
        return once(search, here) if here is search.base else fail()

    monkeypatch.setattr(Search, "round", round_)
    found = answer_of()
    assert found.accepted == ("dry_friction@rail",)
    assert found.parameters["dry_friction@rail.frictionloss"].mean == pytest.approx(1.5, abs=0.1)
    assert found.failed[0].startswith("the search failed by a fault of onlinebayes: RuntimeError: the tensors differ")


@pytest.mark.slow
def test_a_search_that_cannot_begin_leaves_the_base_model(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(explanation, "additions", fail)
    found = answer_of()
    assert found.accepted == ()
    assert found.verdict == "insufficient_data"  # of the table; no fault of the search makes another one of it
    assert found.what_to_record
    assert found.failed[0].startswith("the search failed by a fault of onlinebayes: RuntimeError")


@pytest.mark.slow
def test_where_what_was_found_cannot_be_shown_the_base_model_is(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = answer.fitted_model

    def only_the_base(evaluation, evaluator: Evaluator, *more: object) -> object:
        return whole(evaluation, evaluator, *more) if evaluation.hypothesis == Hypothesis() else fail()

    monkeypatch.setattr(answer, "fitted_model", only_the_base)
    found = answer_of()
    assert found.accepted == ()
    assert "putting the answer together failed by a fault of onlinebayes: RuntimeError: the tensors differ" in " ".join(
        found.failed
    )
