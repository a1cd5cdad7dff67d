"""States on the constraints: exact positions of linkages, nearest states, velocities along the loop, dead points."""

import numpy as np
import torch
from tensordict import TensorDict

from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.simulators.linkages import GRIPPER, SLIDER_CRANK, slider_crank

TURNS = np.linspace(0.3, 14.0, 400)


def state(qpos: np.ndarray, qvel: np.ndarray) -> TensorDict:
    return TensorDict({"qpos": torch.tensor(qpos), "qvel": torch.tensor(qvel)}, batch_size=(len(qpos),))


def tangent(angle: np.ndarray) -> np.ndarray:
    """d (crank, rod, slider) / d crank."""
    return (slider_crank(angle + 1e-6) - slider_crank(angle - 1e-6)) / 2e-6


def test_a_state_beside_the_loop_goes_to_the_nearest_one_on_it() -> None:
    simulator = MujocoSimulator(SLIDER_CRANK).with_rigid_constraints()
    beside = slider_crank(TURNS) + 1e-4 * np.random.default_rng(0).normal(size=(400, 3))
    qpos = simulator.project_onto_constraints(state(beside, np.zeros((400, 3))))["qpos"].numpy()
    np.testing.assert_allclose(qpos, slider_crank(qpos[:, 0]), atol=1e-9)
    along = (tangent(qpos[:, 0]) * (qpos - beside)).sum(-1)
    assert np.abs(along).max() < 1e-7, "the way to the nearest point is square to the loop"


def test_velocities_are_those_of_the_loop() -> None:
    simulator = MujocoSimulator(SLIDER_CRANK).with_rigid_constraints()
    speed = np.linspace(-3, 3, 400)[:, None]
    exact = speed * tangent(TURNS)
    on = simulator.project_onto_constraints(state(slider_crank(TURNS), exact))["qvel"].numpy()
    np.testing.assert_allclose(on, exact, atol=1e-7)
    off = simulator.project_onto_constraints(state(slider_crank(TURNS), exact + 0.1))["qvel"].numpy()
    np.testing.assert_allclose(off, (off[:, :1] / tangent(TURNS)[:, :1]) * tangent(TURNS), atol=1e-6)


def test_what_was_not_measured_follows_from_the_crank_through_full_turns() -> None:
    path = torch.zeros(400, 3, dtype=torch.float64)
    path[:, 0] = torch.tensor(TURNS)
    found = MujocoSimulator(SLIDER_CRANK).constrained_positions(path, [0])
    np.testing.assert_allclose(found.numpy(), slider_crank(TURNS), atol=1e-8)


def test_a_joint_that_is_geared_to_another() -> None:
    path = torch.zeros(50, 2, dtype=torch.float64)
    path[:, 0] = torch.linspace(-0.1, 0.3, 50)
    found = MujocoSimulator(GRIPPER).constrained_positions(path, [0])
    torch.testing.assert_close(found[:, 1], 0.01 + 2 * path[:, 0], atol=1e-9, rtol=0.0)


def test_where_all_were_measured_nothing_is_left_to_follow() -> None:
    path = torch.tensor([[0.0, 0.01], [0.1, 0.2]], dtype=torch.float64)
    assert torch.equal(MujocoSimulator(GRIPPER).constrained_positions(path, [0, 1]), path)


def test_from_a_dead_point_the_slider_does_not_tell_which_way_the_crank_turns() -> None:
    path = torch.zeros(60, 3, dtype=torch.float64)  # the model's own pose is one: crank and rod in line
    path[:, 2] = torch.tensor(slider_crank(np.linspace(0.0, 0.5, 60))[:, 2])
    found = MujocoSimulator(SLIDER_CRANK).constrained_positions(path, [2])
    assert bool(found[:, :2].isnan().all())


def test_soft_constraints_leave_states_where_they_are() -> None:
    given = state(np.ones((1, 3)), np.ones((1, 3)))
    assert MujocoSimulator(SLIDER_CRANK).project_onto_constraints(given) is given


def test_without_constraints_states_stay_what_they_are() -> None:
    simulator = MujocoSimulator(SLIDER_CRANK.split("<equality>")[0] + "</mujoco>")
    given = state(np.ones((1, 3)), np.ones((1, 3)))
    assert simulator.project_onto_constraints(given) is given
    free = simulator.constrained_positions(torch.ones(4, 3, dtype=torch.float64), [0])
    assert bool(free[:, 1:].isnan().all())
    assert bool((free[:, 0] == 1).all())
