"""An environment in the place of a simulator: its worlds, its judge, its episodes, a policy that learns alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import sac
from onlinebayes.runs import BadInput
from onlinebayes.trainers import EnvPlayer, EnvProblem, OnlineState, Point, Schedule, Sizes, online_trainer
from onlinebayes.transforms import ParameterRandomization
from recipes.custom_gym import SPACE, look, pendulum
from tests.trainers.test_playing import after_a_step

PROBLEM = EnvProblem(pendulum, BoxUniform(SPACE), 20, beside=4, episodes=3)
TRUTH = torch.tensor([0.7, 1.2], dtype=torch.float64)


def policy():
    return sac(*PROBLEM.specs).policy


def test_simulations_are_as_many_as_asked_for_in_few_worlds() -> None:
    data = PROBLEM.simulations(8, 5, seed=0).draw([policy()], PROBLEM.prior)
    assert data.shape == (8, 5)
    assert len(data["theta"][:, 0].unique(dim=0)) == 8


def test_so_are_groups() -> None:
    groups = PROBLEM.simulations(8, 5, seed=0).groups([policy(), policy()], PROBLEM.prior)
    assert groups.shape == (8, 2, 5)
    assert len(groups["theta"][:, 0, 0].unique(dim=0)) == 8
    assert torch.equal(groups["theta"][:, 0, 0], groups["theta"][:, 1, 0])


def test_the_hidden_world_tells_no_theta_and_sensors_are_noisy() -> None:
    seen = PROBLEM.hidden(TRUTH, seed=0).run(policy(), 5)
    assert "theta" not in seen
    noisy = replace(PROBLEM, sensor_sd=torch.full((3,), 0.1)).hidden(TRUTH, seed=0).run(policy(), 5)
    length = [run["observation"][..., :2].norm(dim=-1) for run in (seen, noisy)]
    assert (length[0] - 1).abs().max() < 1e-5 < (length[1] - 1).abs().max()


def test_a_policy_is_judged_in_worlds_of_the_truth() -> None:
    good = policy()
    assert PROBLEM.score(good, TRUTH) == PROBLEM.score(good, TRUTH) != PROBLEM.score(good, 0.8 * TRUTH)


@pytest.mark.parametrize("noise", [None, torch.full((3,), 0.05)])
def test_a_right_belief_moves_as_the_real_system_and_a_wrong_one_parts_from_it(noise) -> None:
    player = EnvPlayer(replace(PROBLEM, sensor_sd=noise), policy(), TRUTH, look, dt=0.05)
    right, wrong = player(replaced(TRUTH)), player(replaced(torch.tensor([1.3, 0.6])))
    assert len(right["real"].poses) == len(right["simulated"].poses) == 21
    torch.testing.assert_close(right["simulated"].poses, right["real"].poses)
    torch.testing.assert_close(wrong["real"].poses, right["real"].poses)
    assert (wrong["simulated"].poses - wrong["real"].poses).abs().max() > 1e-2


def replaced(mean: torch.Tensor) -> OnlineState:
    state = after_a_step(mean)
    belief = dict(zip(SPACE.names, [(float(m), 0.1) for m in mean], strict=True))
    state.records[-1] = replace(state.records[-1], belief=belief)
    return state


def trainer(order: str):
    return online_trainer(
        PROBLEM,
        sac(*PROBLEM.specs),
        schedule=Schedule(1, 1, order=order),
        sizes=Sizes(worlds=2, batch_steps=4),
        worlds=Point(TRUTH),
    )


def test_a_policy_that_learns_alone_needs_no_estimator() -> None:
    state = trainer("policy-only").run(OnlineState.begin(PROBLEM.prior))
    assert (state.frames, state.real, state.belief) == (8, None, PROBLEM.prior)
    with pytest.raises(BadInput, match="without an estimator"):
        trainer("online")


def test_worlds_draw_from_the_distribution() -> None:
    theta = PROBLEM.worlds(3, ParameterRandomization(Point(TRUTH)), 0).reset()["theta"]
    torch.testing.assert_close(theta, TRUTH.expand(3, -1))
