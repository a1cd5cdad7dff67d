"""Episodes for a recording: the hidden system's, and the simulator's beside it, driven by the same policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest
import torch

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import ActorCriticSettings, actor_critic, ppo
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.trainers import OnlineState, Problem, SimulatedPlayer
from onlinebayes.trainers.playing import Episode
from tests.trainers.test_online import PRIOR, PROBLEM, TRUTH


def after_a_step(mean: torch.Tensor) -> OnlineState:
    """A state whose last record believes in ``mean``."""
    state = OnlineState.begin(PRIOR)
    state.complete({}, None)
    belief = {name: (float(m), 0.1) for name, m in zip(PROBLEM.space.names, mean, strict=True)}
    state.records[-1] = replace(state.records[-1], belief=belief)
    return state


def parting(played: Mapping[str, Episode]) -> float:
    """The largest distance between the two in the steps that both have."""
    real, simulated = played["real"].poses, played["simulated"].poses
    both = min(len(real), len(simulated))
    return float((simulated[:both] - real[:both]).abs().max())


def test_a_right_belief_moves_as_the_real_system_and_a_wrong_one_parts_from_it() -> None:
    policy = ppo(*PROBLEM.specs).policy
    right = SimulatedPlayer(PROBLEM, policy, TRUTH)(after_a_step(TRUTH))
    wrong = SimulatedPlayer(PROBLEM, policy, TRUTH)(after_a_step(torch.tensor([0.9, 0.9])))
    assert len(right["real"].poses) > 5
    torch.testing.assert_close(right["simulated"].poses, right["real"].poses, rtol=0, atol=1e-9)
    torch.testing.assert_close(wrong["real"].poses, right["real"].poses, rtol=0, atol=0)
    assert parting(wrong) > 1e-3


@pytest.mark.parametrize("noise", [None, torch.full((4,), 0.01)])
def test_a_policy_with_a_memory_plays_through_the_transforms_that_carry_it(noise: torch.Tensor | None) -> None:
    objective = actor_critic(*PROBLEM.specs, ActorCriticSettings(width=8))
    problem = replace(PROBLEM, transforms=objective.transforms, sensor_sd=noise)
    assert len(SimulatedPlayer(problem, objective.policy, TRUTH)(after_a_step(TRUTH))["real"].poses) > 5


def test_the_hidden_system_may_have_more_parameters_than_the_problem() -> None:
    policy, force = ppo(*PROBLEM.specs).policy, Parameter(1.0, 40.0, "N")
    wider = ParameterSpace({**PROBLEM.space, "force": force})
    system = Problem(CartPole(wider), CartPoleTask(), BoxUniform(wider))

    def played(newtons: float) -> Mapping[str, Episode]:
        truth = torch.cat([TRUTH, torch.tensor([newtons], dtype=torch.float64)])
        return SimulatedPlayer(PROBLEM, policy, truth, system)(after_a_step(TRUTH))

    assert parting(played(10.0)) < 1e-9
    assert parting(played(20.0)) > 1e-2
