"""The comparison with mujoco.sysid: it finds a planted truth, names are scored alike for all, a study goes on."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mujoco import sysid as mujoco_sysid

import recipes.studies.versus_sysid.__main__ as study_module
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import QuadraticDrag
from recipes.studies.blind_rigs.names import Answer, answer
from recipes.studies.blind_rigs.workers import Done
from recipes.studies.json_line import line
from recipes.studies.versus_sysid import base
from recipes.studies.versus_sysid.__main__ import Study, main
from recipes.studies.versus_sysid.cases import EMPS, FIRST, RIGS, jobs
from recipes.studies.versus_sysid.judging import Judge, Trial
from recipes.studies.versus_sysid.record import COST, METHODS, Outcome, from_json, scored
from recipes.studies.versus_sysid.sysid_parameters import setter
from recipes.studies.versus_sysid.table import tabulate
from recipes.studies.versus_sysid.task import Fitted, Task, rms
from tests.criticism.rigs import TRUTH, measure, model

DRAG = 1.0
HIDDEN = "quadratic_drag@rail"
needs_sysid = pytest.mark.skipif(
    not hasattr(mujoco_sysid, "optimize"), reason="mujoco.sysid lacks what it needs: pip install -e '.[peers]'"
)
unchecked = pytest.mark.usefixtures("without_shape_checks")


@pytest.fixture(scope="module")
def task() -> Task:
    """A slide with quadratic drag that the model lacks, seen with a tenth of the usual noise."""
    measured = measure({QuadraticDrag("rail", Parameter(0.0, 5.0)): (DRAG,)}, noise=1e-5)
    return Task("slide", model(), measured, ("run7", "run8"))


def error(task: Task, fitted: Fitted) -> float:
    return float(rms(task.held_windows, fitted.predict(task.held_windows)))


# --- it finds a planted truth --------------------------------------------------------------------------------------


@unchecked
@needs_sysid
def test_sysid_finds_the_parameter_and_its_size(task: Task) -> None:
    from recipes.studies.versus_sysid import sysid

    found = sysid.fit(task)
    values = dict(zip([freed.name for freed in found.problem.freed], found.x, strict=True))
    assert frozenset({HIDDEN}) in found.claims
    assert values["drag@rail"] == pytest.approx(DRAG, rel=0.02)
    assert error(task, found) < 0.1 * error(task, base.fit(task))


@unchecked
@needs_sysid
def test_the_cost_is_measured_on_the_same_problem(task: Task) -> None:
    from recipes.studies.versus_sysid import cost

    problem, measured = cost.own_problem(task), task.fit_windows.measured.numpy()
    x = np.array(TRUTH)
    by_hand = problem.residual(x, problem.parameters)[0][0]
    documented = np.concatenate(cost.documented(task)(x, problem.parameters)[0])
    np.testing.assert_allclose(documented.reshape(measured.shape)[measured], by_hand, rtol=1e-4, atol=1e-4)
    assert min(cost.seconds(task)) > 0


@unchecked
@needs_sysid
def test_sysid_with_free_starts_solves_what_ours_solves(task: Task) -> None:
    from recipes.studies.versus_sysid import cost
    from recipes.studies.versus_sysid.free_starts import FreeStarts

    problem = cost.own_problem(task)
    free = FreeStarts(problem)
    starts = task.fit_windows.start.numpy()
    x = np.concatenate([TRUTH, starts.ravel()])
    np.testing.assert_array_equal(free.parameters.as_vector()[len(TRUTH) :], starts.ravel())
    kept = problem.residual(np.array(TRUTH), problem.parameters)[0][0]
    np.testing.assert_array_equal(free.residual(x, free.parameters)[0][0], kept)
    x[len(TRUTH)] += 1e-3  # the first window's position
    moved = free.residual(x, free.parameters)[0][0] != kept
    of = task.fit_windows.measured.nonzero()[:, 0].numpy()
    assert set(of[moved]) == {0}


# --- what they stand on ----------------------------------------------------------------------------------------------


def test_addresses_are_written_where_mujoco_reads_them(task: Task) -> None:
    spec = task.simulator.spec.copy()
    for address, value in (("body.cart.mass", 3.0), ("joint.rail.damping", 0.7), ("actuator.motor.gear[0]", 2.0)):
        setter(address)(spec, value)
    compiled = spec.compile()
    assert (compiled.body_mass[1], compiled.dof_damping[0], compiled.actuator_gear[0, 0]) == (3.0, 0.7, 2.0)
    with pytest.raises(BadInput, match="none of the parameters"):
        setter("joint.rail.frictionloss")


# --- names and records -----------------------------------------------------------------------------------------------


def test_twins_count_once_and_what_is_not_hidden_is_false() -> None:
    load = answer("slide_drive", "constant_load@carriage")
    twins = frozenset({"gravity_tilt@world.x", "com_offset@carriage.x"})
    assert scored([load], [twins]) == (1, 0)
    assert scored([load], [twins, frozenset({"cogging@carriage"})]) == (1, 1)
    assert scored([load], []) == (0, 0)
    assert scored([], [twins]) == (0, 1)
    both = [answer("slide_drive", "asymmetric_friction@carriage")]
    assert scored(both, [frozenset({"dry_friction@carriage"})]) == (0, 0)  # a part of it: not found, not false
    assert scored([Answer(frozenset({"a@b"}), (), frozenset())], [frozenset({"a@b"})]) == (1, 0)


def test_an_outcome_survives_its_file() -> None:
    outcome = Outcome("swing-effect-1000", "ours", ("a@b",), 1.5, ("a@b|c@d",), 1, 0, 3.0)
    assert from_json(line(outcome)) == outcome
    with pytest.raises(ValueError, match="no outcome"):
        from_json('{"method": "guess", "case": "x"}')


def test_a_part_of_the_cases_is_a_sample() -> None:
    found = jobs(60, measured=True)
    assert len(set(found)) == 61
    assert found[0].rig == EMPS
    assert {job.rig for job in found[1:7]} == set(RIGS)
    assert sum(job.kind == "null" for job in found) == 12
    assert all(job.seed >= FIRST for job in found if job.rig not in (EMPS, "driven_pendulum"))


def outcomes(case: str, errors: dict[str, float | None], hidden: tuple[str, ...]) -> list[Outcome]:
    return [
        Outcome(case, method, hidden, errors[method], right=int(method == "ours"), seconds=1.0) for method in METHODS
    ]


def test_the_table_says_where_ours_leads_and_where_it_does_not() -> None:
    leads = {"base": 3.0, "ours": 1.0, "sysid": 1.01}
    found = outcomes("swing-effect-1000", leads, ("dry_friction@hinge",))
    found += [Outcome("swing-effect-1000", COST, seconds=1.0, reference=4.0, starts_free=9.0)]
    found += [Outcome("swing-effect-1003", "ours", error=9.0)]  # not all methods yet: left out
    rows = {row.name: row for row in tabulate(found, "make versus-sysid", 2).rows}
    assert (rows["cases compared"].value, rows["cases compared"].holds) == (1, False)
    assert rows["held-out error, median: onlinebayes refine"].holds
    assert rows["smallest error, within 2 %: mujoco.sysid"].value == 1
    assert rows["right names: onlinebayes refine"].unit == "of 1"
    assert rows["processor time, median: onlinebayes refine"].holds
    assert next(row for name, row in rows.items() if "as documented" in name).value == 4.0
    assert "swing-effect-1003" not in rows
    behind = outcomes("swing-effect-1000", {**leads, "ours": None}, ("dry_friction@hinge",))
    rows = {row.name: row for row in tabulate(behind, "make versus-sysid", 1).rows}
    assert rows["held-out error, median: onlinebayes refine"].holds is False
    assert rows["held-out error, median: onlinebayes refine"].value == math.inf


# --- the study -------------------------------------------------------------------------------------------------------


def test_a_study_goes_on_from_its_finished_trials(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Trial] = []

    def work(todo: Sequence[Trial], do: Judge, processes: int, limit: float) -> Iterator[Done[Trial, Outcome]]:
        for trial in todo:
            if len(asked) == 2:
                asked.append(trial)
                raise KeyboardInterrupt
            asked.append(trial)
            late = trial.method == "sysid"
            outcome = Outcome(trial.job.name, trial.method, error=1.0, seconds=1.0, code=do.code)
            outcome = replace(outcome, reference=3.0) if trial.method == COST else outcome
            yield Done(trial, None if late else outcome, "out of time" if late else "", 1.0)

    monkeypatch.setattr(study_module, "NEEDED", ())
    monkeypatch.setattr(study_module, "work", work)
    monkeypatch.delenv("ONLINEBAYES_DATA", raising=False)
    study = Study(cases=2, out=tmp_path, results=tmp_path / "results")
    assert main(study) == 130
    assert "2 of 8 trials are kept" in capsys.readouterr().err
    part = json.loads((study.results / "versus-sysid.json").read_text())["rows"][0]
    assert (part["value"], part["goal"], part["holds"]) == (0, "2", False)
    assert main(study) == 0
    assert len(asked) == 9  # all, and the one that was interrupted
    text = capsys.readouterr()
    assert "8 trials, 2 of them judged before" in text.err
    assert "cases without an answer: mujoco.sysid: 2" in text.out
    rows = json.loads((study.results / "versus-sysid.json").read_text())["rows"]
    assert rows[0] | {"name": "cases compared", "value": 2} == rows[0]


def test_what_is_not_installed_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(study_module, "NEEDED", ("no_such_package",))
    with pytest.raises(BadInput, match=r"no_such_package not installed.*peers"):
        main(Study(cases=0, out=tmp_path))
    monkeypatch.setattr(study_module, "NEEDED", ())
    with pytest.raises(BadInput, match="0 processes"):
        main(Study(processes=0, out=tmp_path))
