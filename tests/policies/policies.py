"""Small policies of each kind, nothing learnt yet but the statistics of what they see, and torch's answers."""

from __future__ import annotations

import numpy as np
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import Bounded, Categorical, Composite, OneHot, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.objectives import (
    ActorCriticSettings,
    DDPGSettings,
    Hindsight,
    PPOSettings,
    SACSettings,
    actor_critic,
    ddpg,
    ppo,
    sac,
)
from onlinebayes.objectives.base import Objective

SEEN = Composite(observation=Unbounded((5,)), desired_goal=Unbounded((2,)))
PUSH = Bounded(torch.tensor([-2.0, 0.5]), torch.tensor([2.0, 4.0]))
GOALS = Hindsight(lambda achieved, desired: -(achieved - desired).norm(dim=-1))
KEYS = ["observation", "desired_goal"]


def make(kind: str) -> Objective:
    """An objective of a kind."""
    made: dict[str, Objective] = {
        "ppo": ppo(SEEN, PUSH, PPOSettings(normalise=True)),
        "sac": sac(SEEN, PUSH, SACSettings(widths=(32,))),
        "ddpg": ddpg(SEEN, PUSH, DDPGSettings(widths=(64, 64)), in_keys=KEYS, hindsight=GOALS),
        "one-hot": ppo(SEEN, OneHot(3)),
        "index": ppo(SEEN, Categorical(4)),
        "recurrent": actor_critic(SEEN, PUSH, ActorCriticSettings(normalise=True, width=16)),
    }
    objective = made[kind]
    if objective.inputs.normalisation is not None:  # type: ignore[attr-defined]
        objective.inputs.normalisation.observe(1 + 3 * torch.randn(200, objective.inputs.width))  # type: ignore[attr-defined]
    return objective


def observations(number: int) -> TensorDict:
    """Rows, some of them far out."""
    scale = torch.logspace(-1, 1.5, number)[:, None]
    return TensorDict({key: scale * torch.randn(number, SEEN[key].shape[0]) for key in KEYS}, [number])


def acted(policy, data: TensorDict) -> np.ndarray:
    """Torch's deterministic actions."""
    with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
        action: Tensor = policy(data.clone())["action"]
    return action.numpy()
