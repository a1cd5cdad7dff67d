"""Soft actor-critic: an off-policy policy of maximum entropy.

    Q target   y = R + gamma (1 - terminated) (min_i Q'_i(s', a') - alpha log pi(a' | s')),   a' ~ pi
    actor      minimise  E[alpha log pi(a | s) - min_i Q_i(s, a)]
    alpha      such that the policy's entropy is -A nats;      Q' follows Q with rate tau

Haarnoja et al., Soft Actor-Critic Algorithms and Applications (2018). The loss is TorchRL's ``SACLoss``.

The buffer is a short memory on purpose: the worlds that data comes from narrow as the posterior does, and transitions
of worlds that were ruled out should fade.

Where an update's time goes (64 x 64 networks, batch 256, one core): of 5-6 ms some 4 ms are ``SACLoss``'s bookkeeping
(parameters swapped into modules, TensorDicts split and stacked), independent of the batch, and 1 ms is backward. Fused
Adam saves 1 ms against the default; looping over the two Q networks costs what vmap costs, and ``torch.compile`` gives
up on the functional calls. Width is dear (256 x 256: 12 ms), batch is cheap: prefer few updates of large batches.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import TensorDictBase
from torch import nn
from torchrl.data import LazyTensorStorage, ReplayBuffer, TensorSpec
from torchrl.modules import ProbabilisticActor
from torchrl.objectives import SACLoss, SoftUpdate, ValueEstimators

from onlinebayes.objectives.networks import action_value, stochastic_policy

LOSSES = ("loss_actor", "loss_qvalue", "loss_alpha")


@dataclass(frozen=True, eq=False)
class SAC:
    """The pieces of SAC, each usable alone; :meth:`update` shows how they fit together.

    Args:
        policy: stochastic policy on a bounded action.
        loss: holds the policy, two Q networks, their targets and alpha.
        target: moves the target networks.
        buffer: the memory; its size says how soon old worlds fade.
        optimiser: over the loss's parameters.
        frames_per_update: fresh frames for which one gradient step is taken.
        reward_scale: factor on the reward.
    """

    policy: ProbabilisticActor
    loss: SACLoss
    target: SoftUpdate
    buffer: ReplayBuffer
    optimiser: torch.optim.Optimizer
    frames_per_update: int
    reward_scale: float

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """Remember a collector's batch (N, T) and take its share of gradient steps; returns the losses' means."""
        fresh = data.select(*self.loss.in_keys).reshape(-1)
        fresh["next", "reward"] = self.reward_scale * fresh["next", "reward"]
        self.buffer.extend(fresh)
        steps = max(1, fresh.numel() // self.frames_per_update)
        sums: dict[str, float] = defaultdict(float)
        for _ in range(steps):
            losses = self.loss(self.buffer.sample())
            (losses["loss_actor"] + losses["loss_qvalue"] + losses["loss_alpha"]).backward()
            self.optimiser.step()
            self.optimiser.zero_grad()
            self.target.step()
            for name in (*LOSSES, "alpha", "entropy"):
                sums[name] += float(losses[name].detach())
        return {name: value / steps for name, value in sums.items()}

    def state_dict(self) -> dict[str, Any]:
        """Weights, optimiser state and memory."""
        return {
            "loss": self.loss.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "buffer": self.buffer.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`state_dict` gave."""
        self.loss.load_state_dict(state["loss"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.buffer.load_state_dict(state["buffer"])


def sac(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    *,
    memory: int = 20_000,
    minibatch: int = 256,
    frames_per_update: int = 8,
    widths: Sequence[int] = (64, 64),
    activation: type[nn.Module] = nn.ReLU,
    gamma: float = 0.99,
    tau: float = 0.005,
    learning_rate: float = 1e-3,
    alpha: float = 1.0,
    reward_scale: float = 1.0,
) -> SAC:
    """SAC with a policy and two Q networks built from the leaf specs of one world.

    Args:
        observation_spec: shape (O,).
        action_spec: ``Bounded``, shape (A,).
        memory: transitions kept; old ones are overwritten.
        minibatch: transitions of one gradient step.
        frames_per_update: fresh frames for which one gradient step is taken.
        widths: units of the hidden layers.
        activation: between the layers.
        gamma: discount factor.
        tau: share of Q in its target at each step.
        learning_rate: Adam's.
        alpha: the entropy's weight to begin with; it is learnt.
        reward_scale: factor on the reward; values of order 1 to 100 learn best.
    """
    policy = stochastic_policy(observation_spec, action_spec, widths, activation=activation)
    value = action_value(observation_spec, action_spec, widths, activation=activation)
    loss = SACLoss(policy, value, action_spec=action_spec, alpha_init=alpha, loss_function="l2")
    loss.make_value_estimator(ValueEstimators.TD0, gamma=gamma)
    target = SoftUpdate(loss, tau=tau)
    buffer = ReplayBuffer(storage=LazyTensorStorage(memory, device=observation_spec.device), batch_size=minibatch)
    optimiser = torch.optim.Adam(loss.parameters(), lr=learning_rate, fused=True)
    return SAC(policy, loss, target, buffer, optimiser, frames_per_update, reward_scale)
