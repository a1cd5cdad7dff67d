"""Soft actor-critic: an off-policy policy of maximum entropy.

    Q target   y = R + gamma (1 - terminated) (min_i Q'_i(s', a') - alpha log pi(a' | s')),   a' ~ pi
    actor      minimise  E[alpha log pi(a | s) - min_i Q_i(s, a)]
    alpha      such that the policy's entropy is -1 nat an action, ranges scaled to [-1, 1]
    targets    Q' follows Q with rate tau

Haarnoja et al., Soft Actor-Critic Algorithms and Applications (2018); the losses stand in ``soft_loss``.

The memory is short on purpose: the worlds that data comes from narrow as the posterior does, and transitions of worlds
that were ruled out should fade.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import NestedKey, TensorDictBase
from torch import nn
from torchrl.data import Bounded, TensorSpec
from torchrl.modules import ProbabilisticActor

from onlinebayes.objectives.annealing import anneal
from onlinebayes.objectives.buffer import TransitionBuffer
from onlinebayes.objectives.checks import (
    check_bounds,
    check_counts,
    check_discount,
    check_layers,
    check_positive,
    check_rate_of_targets,
)
from onlinebayes.objectives.ensemble import EnsembleMLP
from onlinebayes.objectives.inputs import KEYS, Inputs, after, inputs_of, selected
from onlinebayes.objectives.networks import stochastic_policy, unsupported
from onlinebayes.objectives.soft_loss import SoftLoss
from onlinebayes.objectives.targets import Follower
from onlinebayes.runs import heed, load_exactly


@dataclass(frozen=True, kw_only=True)
class SACSettings:
    """Settings of SAC.

    Raises:
        BadInput: a number with which nothing can be learnt.
    """

    normalise: bool = False
    """whether what is seen is normalised by its running mean and standard deviation"""
    widths: tuple[int, ...] = (64, 64)
    """units of the hidden layers, of the policy and of each critic"""
    activation: type[nn.Module] = nn.ReLU
    """between the layers"""
    memory: int = 20_000
    """transitions kept; old ones are overwritten"""
    minibatch: int = 256
    """transitions of one gradient step"""
    frames_per_update: int = 8
    """fresh frames for which one gradient step is taken"""
    gamma: float = 0.99
    """discount factor of a step, at least 0 and below 1"""
    tau: float = 0.005
    """share of the gap to the critics that their targets close at each gradient step, above 0 and at most 1"""
    learning_rate: float = 1e-3
    """Adam's, above 0"""
    anneal_frames: int | None = None
    """frames over which the learning rate falls in a line to zero; it stays without it"""
    alpha: float = 1.0
    """the entropy's weight to begin with [reward / nat], above 0; it is learnt"""
    reward_scale: float = 1.0
    """factor on the reward, above 0; values of order 1 to 100 learn best"""

    def __post_init__(self) -> None:
        check_discount(self.gamma)
        check_layers(self.widths, self.activation)
        check_counts(memory=self.memory, minibatch=self.minibatch, frames_per_update=self.frames_per_update)
        check_rate_of_targets(self.tau)
        check_positive(learning_rate=self.learning_rate, alpha=self.alpha, reward_scale=self.reward_scale)
        if self.anneal_frames is not None:
            check_counts(anneal_frames=self.anneal_frames)


@dataclass(frozen=True, eq=False)
class SAC:
    """The pieces of SAC, each usable alone; :meth:`update` shows how they fit together.

    Args:
        policy: stochastic policy on a bounded action.
        inputs: what policy and critics see.
        loss: holds the policy, two critics, their targets and alpha.
        target: moves the target networks.
        buffer: transitions; its size says how soon old worlds fade.
        optimiser: over what learns in the loss.
        settings: the numbers that it was built with.
    """

    policy: ProbabilisticActor
    inputs: Inputs
    loss: SoftLoss
    target: Follower[EnsembleMLP]
    buffer: TransitionBuffer
    optimiser: torch.optim.Optimizer
    settings: SACSettings

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """Remember a collector's batch (N, T) and take its share of gradient steps; returns the losses' means.

        Raises:
            BadInput: the batch lacks a key, one has another width than the networks were built for, or a value is NaN
                or infinite; nothing was learnt from the batch.
        """
        fresh = selected(data, self.loss.in_keys).reshape(-1)
        self.inputs.observe(fresh)
        fresh["next", "reward"] = self.settings.reward_scale * fresh["next", "reward"]
        self.buffer.extend(fresh)
        steps = max(1, fresh.numel() // self.settings.frames_per_update)
        sums: dict[str, Any] = defaultdict(float)
        for _ in range(steps):
            heed()
            for name, value in self.step().items():
                sums[name] += value
        anneal(self.optimiser, self.settings, fresh.numel())
        return {name: float(value) / steps for name, value in sums.items()}

    def step(self) -> dict[str, torch.Tensor]:
        """One gradient step on a minibatch of the buffer; the losses, detached."""
        rows = self.buffer.draw(self.settings.minibatch)
        row = self.inputs(*(rows[key] for key in self.inputs.keys))
        following = self.inputs(*(rows[after(key)] for key in self.inputs.keys))
        actor, qvalue, alpha, entropy = self.loss.losses(
            row,
            rows[self.loss.action_key].to(row),
            rows["next", "reward"].to(row),
            rows["next", "terminated"],
            following,
        )
        self.optimiser.zero_grad()
        (actor + qvalue + alpha).backward()
        self.optimiser.step()
        self.target.step()
        return {
            "loss_actor": actor.detach(),
            "loss_qvalue": qvalue.detach(),
            "loss_alpha": alpha.detach(),
            "alpha": self.loss.log_alpha.detach().exp(),
            "entropy": entropy,
        }

    def state_dict(self) -> dict[str, Any]:
        """Weights, optimiser state and buffer."""
        return {
            "loss": self.loss.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "buffer": self.buffer.state_dict(),
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from what :meth:`state_dict` gave."""
        load_exactly("loss", self.loss, state["loss"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.buffer.load_state_dict(state["buffer"])


def sac(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    settings: SACSettings = SACSettings(),
    *,
    in_keys: Sequence[NestedKey] = KEYS,
) -> SAC:
    """SAC with a policy and two critics built from the specs of one world.

    Args:
        observation_spec: shape (O,), or a Composite that holds every key.
        action_spec: ``Bounded``, shape (A,).
        settings: of networks, memory and loss.
        in_keys: what policy and critics see.

    Raises:
        BadInput: an action that is not bounded, or a key that the spec lacks.
    """
    if not isinstance(action_spec, Bounded) or action_spec.ndim != 1:
        raise unsupported(action_spec, "Bounded (A,)")
    check_bounds(action_spec)
    widths, activation = settings.widths, settings.activation
    inputs = inputs_of(observation_spec, in_keys, normalise=settings.normalise)
    policy = stochastic_policy(observation_spec, action_spec, widths, activation=activation, inputs=inputs)
    actor, device = policy.get_submodule("module.0.module").body, observation_spec.device
    critics = EnsembleMLP(2, inputs.width + action_spec.shape[-1], 1, widths, activation, device)
    target = Follower(critics, settings.tau)
    bounds = (action_spec.space.low, action_spec.space.high)
    loss = SoftLoss(inputs, actor, critics, target.network, *bounds, gamma=settings.gamma, alpha=settings.alpha)
    learning = [weight for weight in loss.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(learning, lr=settings.learning_rate, fused=True)
    buffer = TransitionBuffer(settings.memory, device=device)
    return SAC(policy, inputs, loss, target, buffer, optimiser, settings)
