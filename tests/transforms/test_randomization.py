"""Theta is drawn for exactly the worlds that reset, stays within an episode, and reaches the simulator."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.envs import SerialEnv, TransformedEnv

from onlinebayes.transforms import ParameterRandomization
from onlinebayes.transforms.testing import check_parallel, check_transform
from tests.transforms.systems import Uniform, make_env


def test_conforms() -> None:
    check_transform(make_env, _transform, lambda: TensorDict({"x": torch.zeros(4, 5, 1)}, batch_size=(4, 5)))


@pytest.mark.slow
def test_conforms_in_processes() -> None:
    check_parallel(make_env, _transform)


def test_new_parameters_exactly_where_an_episode_ended() -> None:
    env = TransformedEnv(make_env(worlds=8), ParameterRandomization(Uniform()))
    collector = Collector(env, frames_per_batch=8 * 120, total_frames=8 * 120, track_traj_ids=False)
    data = next(iter(collector))
    ended, theta = data["next", "done"][:, :-1, 0], data["theta"]
    assert ended.sum() > 10
    assert theta[:, 0].unique(dim=0).shape[0] == 8  # every world its own
    assert torch.equal((theta[:, 1:] != theta[:, :-1]).any(-1), ended)
    assert torch.equal(data["next", "theta"], theta)  # carried through the step that ends an episode


def test_no_draw_is_made_for_worlds_that_go_on() -> None:
    distribution = Uniform()
    env = TransformedEnv(make_env(worlds=8), ParameterRandomization(distribution))
    state = env.reset()
    assert distribution.asked == [8]
    for _ in range(80):
        distribution.asked.clear()
        data, state = env.step_and_maybe_reset(env.rand_action(state))
        assert sum(distribution.asked) == int(data["next", "done"].sum())


def test_the_simulator_runs_on_what_was_drawn() -> None:
    env = TransformedEnv(make_env(worlds=4), ParameterRandomization(Uniform()))
    data = env.rollout(80, break_when_any_done=False)
    assert torch.equal(env.simulator.theta, data["next", "theta"][:, -1])


def test_the_simulators_below_several_environments_get_their_own_rows() -> None:
    env = TransformedEnv(SerialEnv(2, make_env), ParameterRandomization(Uniform()))
    data = env.rollout(80, break_when_any_done=False)
    below = torch.stack([inner.simulator.theta for inner in env.base_env._envs])
    assert torch.equal(below, data["next", "theta"][:, :, -1])
    assert below.reshape(-1, 2).unique(dim=0).shape[0] == 6


def test_a_new_distribution_takes_effect_world_by_world() -> None:
    env = TransformedEnv(make_env(worlds=6), ParameterRandomization(Uniform(0.1, 0.2)))
    state = env.reset()
    env.transform.set_distribution(Uniform(0.8, 0.9))
    assert (state["theta"] < 0.2).all()
    seen_both = False
    for _ in range(80):
        _, state = env.step_and_maybe_reset(env.rand_action(state))
        old, new = (state["theta"] < 0.2).all(-1), (state["theta"] > 0.8).all(-1)
        assert (old ^ new).all()
        seen_both |= bool(old.any() and new.any())
    assert seen_both
    assert new.all()


def test_partial_reset_by_hand() -> None:
    env = TransformedEnv(make_env(worlds=3), ParameterRandomization(Uniform()))
    state = env.reset()
    before = state["theta"].clone()
    mask = torch.tensor([[True], [False], [True]])
    state["_reset"] = mask
    after = env.reset(state)["theta"]
    assert torch.equal((after != before).any(-1, keepdim=True), mask)


def test_as_a_module_it_draws_for_every_element() -> None:
    data = ParameterRandomization(Uniform())(TensorDict(batch_size=(5, 2)))
    assert data["theta"].shape == (5, 2, 2)
    assert data["theta"].reshape(10, 2).unique(dim=0).shape[0] == 10


def _transform() -> ParameterRandomization:
    return ParameterRandomization(Uniform())
