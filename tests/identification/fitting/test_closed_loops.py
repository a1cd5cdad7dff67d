"""A slider-crank with one encoder, logged by an equation of motion of its own: right as it is, and with friction."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import Selection, compare
from onlinebayes.criticism.candidates.candidates import propose
from onlinebayes.criticism.candidates.survey import survey
from onlinebayes.criticism.findings.reading_notes import tie_notes
from onlinebayes.criticism.searching.context import SearchContext
from onlinebayes.criticism.searching.search import SearchResult, ground
from onlinebayes.criticism.searching.stage import refit
from onlinebayes.criticism.task import Task, prepare
from onlinebayes.identification.data.noise import measured_floors
from onlinebayes.identification.fitting.closed_loops import completed
from onlinebayes.identification.fitting.numerics import settle
from onlinebayes.identification.fitting.projection import misfit
from onlinebayes.identification.fitting.readings import follows_far_better
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.simulators.linkages import SLIDER_CRANK, driven_slider_crank, slider_crank

refining = import_module("onlinebayes.criticism.commands")


@pytest.fixture
def simulator() -> MujocoSimulator:
    return MujocoSimulator(SLIDER_CRANK, ParameterSpace({"joint.crank.damping": Parameter(0.0, 0.1)}))


def test_the_other_joints_are_worked_out_from_the_crank(simulator: MujocoSimulator) -> None:
    log = driven_slider_crank(0.0, runs=2, seconds=1.0)
    log["r1"]["qpos.crank"][20] = torch.nan
    full, (note,) = completed(simulator, Measurement.from_runs(log))
    assert "qpos.rod, qpos.slider" in note
    assert [signal.unit for signal in full.signals[1:]] == ["rad", "m"]
    exact = torch.tensor(slider_crank(log["r0"]["qpos.crank"]))
    torch.testing.assert_close(full.data["signal"][0], exact, atol=1e-8, rtol=0.0)
    assert not bool(full.data["measured"][1, 20].any())
    assert completed(simulator, full) == (full, ())


def test_a_free_joint_without_a_signal_is_asked_for(simulator: MujocoSimulator) -> None:
    loose = MujocoSimulator(SLIDER_CRANK.split("<equality>")[0] + SLIDER_CRANK.split("</equality>")[1])
    log = Measurement.from_runs(driven_slider_crank(0.0, runs=2, seconds=1.0))
    with pytest.raises(BadInput, match="joint 'rod' has no measured position"):
        compare(loose, log)


@pytest.mark.long
def test_a_right_model_of_it_is_adequate(simulator: MujocoSimulator, without_shape_checks: None) -> None:
    log = Measurement.from_runs(driven_slider_crank(0.0, runs=4, seconds=4.0))
    found = compare(simulator, log, holdout=["r3"])
    assert found.verdict == "adequate"
    assert found.final.theta.tolist() == pytest.approx([0.01], rel=0.02)
    assert any("taken as rigid" in note for note in found.notes)


def written_by_mujoco(simulator: MujocoSimulator, runs: int, seconds: float) -> Measurement:
    """All joints of a loop that is as soft as MuJoCo's default."""
    driven = driven_slider_crank(0.0, runs=runs, seconds=seconds)
    command = torch.tensor(np.stack([log["ctrl.motor"] for log in driven.values()]))[..., None]
    rest = TensorDict({"qpos": torch.zeros(runs, 3), "qvel": torch.zeros(runs, 3)}, batch_size=(runs,)).double()
    times = torch.tensor(driven["r0"]["time"]) + 0.005
    inputs = TensorDict({"command": command}, batch_size=command.shape[:2])
    path = simulator.rollout(simulator.nominal.expand(runs, 1), rest, inputs, times)["qpos"]
    noise = torch.randn(runs, len(times), 3, generator=torch.Generator().manual_seed(0)).double()
    path = torch.cat([rest["qpos"][:, None], path[:, :-1]], 1) + 1e-4 * noise
    joints = ("qpos.crank", "qpos.rod", "qpos.slider")
    return Measurement.from_runs(
        {
            run: {**columns, **dict(zip(joints, q.T.numpy(), strict=True))}
            for (run, columns), q in zip(driven.items(), path, strict=True)
        }
    )


@pytest.mark.long
def test_a_log_that_mujoco_wrote_is_as_soft_as_mujoco(simulator: MujocoSimulator, without_shape_checks: None) -> None:
    found = compare(simulator, written_by_mujoco(simulator, 4, 4.0), holdout=["r3"])
    assert found.verdict == "adequate"
    assert not any("taken as rigid" in note for note in found.notes)


@pytest.mark.slow
def test_constraints_are_asked_of_the_log_again(simulator: MujocoSimulator, without_shape_checks: None) -> None:
    """What else is missing may hide it from the base model: with all that was found the other way is tried."""
    log = written_by_mujoco(simulator, 2, 1.0)
    rigid, noise = simulator.with_rigid_constraints(), measured_floors(log)
    wrong, right = (settle(model, log, 0.5, noise) for model in (rigid, simulator))
    assert follows_far_better(wrong, log, simulator)
    assert not follows_far_better(right, log, rigid)


@pytest.mark.long
def test_the_search_goes_on_with_the_other_constraints(
    simulator: MujocoSimulator, monkeypatch: pytest.MonkeyPatch
) -> None:
    log, _ = completed(simulator, Measurement.from_runs(driven_slider_crank(0.0, runs=2, seconds=1.0)))
    rigid, asked = simulator.with_rigid_constraints(), []
    tied = Task(rigid, log, log, Selection(), (), simulator)
    other = replace(tied, simulator=simulator, otherwise_tied=rigid)
    monkeypatch.setattr(Task, "read_otherwise", lambda task, found: other)
    monkeypatch.setattr(refining, "inquire", lambda model, *_: asked.append(model) or (found, None))
    monkeypatch.setattr(refining, "misfit", lambda _: next(left))
    left, base = iter([1.0, 3.0]), ground(rigid, log, Selection())
    found = SearchResult(base, base)
    context = SearchContext(log, Selection())
    assert refining._read_otherwise(tied, found, context, 1) == (other, found)
    assert asked == [simulator]
    assert [len(tie_notes(task.simulator, task.otherwise_tied)) for task in (tied, other)] == [1, 0]


@pytest.mark.long
def test_friction_at_the_slider_is_recovered_though_screening_begins_astray(
    simulator: MujocoSimulator, without_shape_checks: None
) -> None:
    """Screening's size with the damping that stood in for it errs more than the model without: it starts at half."""
    log = Measurement.from_runs(driven_slider_crank(0.8, runs=4, seconds=4.0))
    task = prepare(simulator, log, ["r3"], Selection(), None)
    base = ground(task.simulator, task.fit_runs, task.selection)
    (effect,) = propose(base.fitted.simulator, base.windows, ["dry_friction@slider"])
    (screened,) = survey(base.fitted, base.windows, [effect], None).screened
    fitted, _ = refit(base.fitted, base.windows, effect, screened.start, promised=screened.promise)
    assert misfit(fitted.projected) < 0.1 * misfit(base.fitted.projected)
    assert fitted.theta.tolist() == pytest.approx([0.01, 0.8], rel=0.05)
