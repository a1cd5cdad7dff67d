"""Policies and how they learn: specs -> policy, loss module, buffer."""

from onlinebayes.objectives.actor_critic import ActorCritic, ActorCriticSettings, actor_critic
from onlinebayes.objectives.base import Objective, TakesBelief, settings_of
from onlinebayes.objectives.buffer import TransitionBuffer
from onlinebayes.objectives.ddpg import DDPG, DDPGSettings, ddpg
from onlinebayes.objectives.deterministic_loss import DeterministicLoss
from onlinebayes.objectives.ensemble import EnsembleMLP
from onlinebayes.objectives.exploration import Exploration
from onlinebayes.objectives.exported import exported, save_policy
from onlinebayes.objectives.hindsight import EpisodeReplay, Hindsight
from onlinebayes.objectives.inputs import Inputs, inputs_of
from onlinebayes.objectives.networks import action_value, state_value, stochastic_policy
from onlinebayes.objectives.normalisation import RunningNormalization
from onlinebayes.objectives.planned import Planned
from onlinebayes.objectives.ppo import PPO, PPOSettings, ppo
from onlinebayes.objectives.recurrent_network import RecurrentNetwork
from onlinebayes.objectives.sac import SAC, SACSettings, sac
from onlinebayes.objectives.soft_loss import SoftLoss
from onlinebayes.objectives.targets import Follower

__all__ = [
    "DDPG",
    "PPO",
    "SAC",
    "ActorCritic",
    "ActorCriticSettings",
    "DDPGSettings",
    "DeterministicLoss",
    "EnsembleMLP",
    "EpisodeReplay",
    "Exploration",
    "Follower",
    "Hindsight",
    "Inputs",
    "Objective",
    "PPOSettings",
    "Planned",
    "RecurrentNetwork",
    "RunningNormalization",
    "SACSettings",
    "SoftLoss",
    "TakesBelief",
    "TransitionBuffer",
    "action_value",
    "actor_critic",
    "ddpg",
    "exported",
    "inputs_of",
    "ppo",
    "sac",
    "save_policy",
    "settings_of",
    "state_value",
    "stochastic_policy",
]
