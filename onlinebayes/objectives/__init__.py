"""Policies and how they learn: specs -> policy, loss module, buffer."""

from onlinebayes.objectives.base import Objective
from onlinebayes.objectives.networks import action_value, state_value, stochastic_policy
from onlinebayes.objectives.ppo import PPO, ppo
from onlinebayes.objectives.sac import SAC, sac

__all__ = ["PPO", "SAC", "Objective", "action_value", "ppo", "sac", "state_value", "stochastic_policy"]
