"""A slider-crank with one encoder, logged by an equation of motion of its own: right as it is, and with friction."""

from importlib import import_module

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import compare
from onlinebayes.identification.fitting.closed_loops import completed
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
