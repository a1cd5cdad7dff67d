"""What the settings of objectives refuse, and that they are what was built."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, asdict

import pytest
import torch
from torch import nn
from torchrl.data import Bounded, Unbounded

from onlinebayes.objectives import (
    ActorCriticSettings,
    DDPGSettings,
    PPOSettings,
    SACSettings,
    actor_critic,
    ddpg,
    ppo,
    sac,
)
from onlinebayes.runs import BadInput

ALL = ((ppo, PPOSettings), (sac, SACSettings), (ddpg, DDPGSettings), (actor_critic, ActorCriticSettings))


@pytest.mark.parametrize(
    ("settings", "values", "said"),
    [
        (PPOSettings, {"gamma": 1.0}, "gamma = 1.0: a discount factor is .* below 1; give another gamma"),
        (SACSettings, {"gamma": 1.5}, r"gamma = 1\.5"),
        (DDPGSettings, {"gamma": -0.1}, "gamma"),
        (ActorCriticSettings, {"gamma": float("nan")}, "gamma"),
        (SACSettings, {"minibatch": 0}, "minibatch = 0: it must be a whole number, one or more; give another"),
        (SACSettings, {"frames_per_update": 0}, "frames_per_update"),
        (SACSettings, {"alpha": 0.0}, "alpha = 0.0: it must be positive and finite"),
        (SACSettings, {"reward_scale": float("inf")}, "reward_scale"),
        (SACSettings, {"memory": 0}, "memory"),
        (SACSettings, {"widths": (64, 0)}, r"widths = \(64, 0\): a layer has"),
        (DDPGSettings, {"tau": 0.0}, "tau"),
        (DDPGSettings, {"tau": 1.5}, r"tau = 1\.5: targets follow"),
        (DDPGSettings, {"steps": 0}, "steps"),
        (DDPGSettings, {"demonstrations": 1.5}, "demonstrations = 1.5: a share"),
        (DDPGSettings, {"action_penalty": -1.0}, "action_penalty = -1.0: it must be finite and not negative"),
        (DDPGSettings, {"value_range": (0.0, -20.0)}, "value_range .* turn them round"),
        (PPOSettings, {"epochs": 0}, "epochs"),
        (PPOSettings, {"lmbda": 1.1}, "lmbda"),
        (PPOSettings, {"entropy": -0.1}, "entropy"),
        (PPOSettings, {"target_kl": 0.0}, "target_kl"),
        (PPOSettings, {"max_grad_norm": 0.0}, "max_grad_norm = 0.0: it must be above 0; give infinity"),
        (PPOSettings, {"minibatch": 128, "frames_per_batch": 64}, "at most frames_per_batch = 64"),
        (ActorCriticSettings, {"learning_rate": float("nan")}, "learning_rate"),
        (ActorCriticSettings, {"width": 0}, "width"),
    ],
)
def test_numbers_with_which_nothing_can_be_learnt_are_refused(settings, values, said) -> None:
    with pytest.raises(BadInput, match=said):
        settings(**values)


@pytest.mark.usefixtures("without_shape_checks")
@pytest.mark.parametrize("settings", [settings for _, settings in ALL])
def test_an_activation_is_a_class(settings) -> None:
    with pytest.raises(BadInput, match=r"a class of torch\.nn; give torch.nn.ReLU"):
        settings(activation=nn.Tanh())


@pytest.mark.parametrize(("build", "settings"), ALL)
def test_an_objective_has_the_settings_that_it_was_built_with(build, settings) -> None:
    chosen = settings(gamma=0.5, learning_rate=2e-3)
    specs = Unbounded((3,)), Bounded(torch.tensor([-2.0, 0.0]), torch.tensor([2.0, 1.0]))
    assert build(*specs).settings == settings()
    objective = build(*specs, chosen)
    assert objective.settings == chosen
    assert objective.optimiser.param_groups[0]["lr"] == 2e-3
    assert asdict(objective.settings) == asdict(chosen)
    with pytest.raises(FrozenInstanceError):
        objective.settings.gamma = 0.9
