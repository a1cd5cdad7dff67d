"""Proximal policy optimisation: clipped importance ratios on generalised advantages.

    maximise  E[min(r A, clip(r, 1 - eps, 1 + eps) A)] + c H(pi),      r = pi(a | s) / pi_old(a | s)
    A_t = sum_k (gamma lambda)^k (R_{t+k} + gamma V(s_{t+k+1}) - V(s_{t+k})),      R = (1 - gamma) x reward

Schulman et al., Proximal Policy Optimization Algorithms (2017); High-Dimensional Continuous Control Using Generalized
Advantage Estimation (2016). The loss and the advantage are TorchRL's ``ClipPPOLoss`` and ``GAE``.

Two choices decide whether it learns quickly: the reward is multiplied by (1 - gamma), so that values are of order one
whatever the horizon, and the gradients of actor and critic are clipped apart, so that a surprised critic does not
silence the actor.

With ``target_kl`` the learning rate follows the divergence of a batch's new policy from the old one: a 1.5th of it
where that is above twice the target, 1.5 times it where it is below half of it (Rudin et al., Learning to Walk in
Minutes Using Massively Parallel Deep Reinforcement Learning, 2022).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import NestedKey, TensorDictBase
from torch import nn
from torch.nn.utils import clip_grad_norm_
from torchrl.data import LazyTensorStorage, ReplayBuffer, SamplerWithoutReplacement, TensorSpec
from torchrl.modules import ProbabilisticActor
from torchrl.objectives import ClipPPOLoss
from torchrl.objectives.value import GAE

from onlinebayes.objectives.annealing import anneal
from onlinebayes.objectives.checks import (
    check_bound_on_gradients,
    check_counts,
    check_discount,
    check_layers,
    check_positive,
    check_shares,
    check_weights,
)
from onlinebayes.objectives.inputs import KEYS, Inputs, after, inputs_of, selected
from onlinebayes.objectives.networks import state_value, stochastic_policy
from onlinebayes.runs import BadInput, heed, load_exactly

LOG_PROB = "action_log_prob"
PACE, SLOWEST, FASTEST = 1.5, 1e-5, 1e-2
"""Factor of the learning rate after a batch whose divergence is off its target, and its bounds."""
LOSSES = ("loss_objective", "loss_critic", "loss_entropy")


@dataclass(frozen=True, kw_only=True)
class PPOSettings:
    """Settings of PPO.

    Raises:
        BadInput: a number with which nothing can be learnt.
    """

    normalise: bool = False
    """whether what is seen is normalised by its running mean and standard deviation"""
    widths: tuple[int, ...] = (64, 64)
    """units of the hidden layers, of the policy and of the critic"""
    activation: type[nn.Module] = nn.Tanh
    """between the layers"""
    frames_per_batch: int = 4096
    """most frames N x T of one :meth:`PPO.update`"""
    minibatch: int = 512
    """frames of one gradient step; at most ``frames_per_batch``"""
    epochs: int = 4
    """passes over each batch"""
    gamma: float = 0.99
    """discount factor of a step, at least 0 and below 1; the reward is multiplied by 1 - gamma"""
    lmbda: float = 0.95
    """lambda of the advantage, 0 to 1"""
    clip: float = 0.2
    """eps of the objective, above 0"""
    entropy: float = 0.01
    """c of the objective, 0 or more"""
    learning_rate: float = 1e-3
    """Adam's, above 0; to begin with, where it follows ``target_kl``"""
    anneal_frames: int | None = None
    """frames over which the learning rate falls in a line to zero; it stays without it"""
    max_grad_norm: float = 0.5
    """bound on the gradient's norm, for the policy and for the critic; above 0, infinite for none"""
    target_kl: float | None = None
    """divergence that a batch should bring [nats], which the learning rate follows; it stays without it"""

    def __post_init__(self) -> None:
        check_discount(self.gamma)
        check_layers(self.widths, self.activation)
        check_counts(frames_per_batch=self.frames_per_batch, minibatch=self.minibatch, epochs=self.epochs)
        check_shares(lmbda=self.lmbda)
        check_positive(clip=self.clip, learning_rate=self.learning_rate)
        check_weights(entropy=self.entropy)
        if self.target_kl is not None:
            check_positive(target_kl=self.target_kl)
        check_bound_on_gradients(self.max_grad_norm)
        if self.minibatch > self.frames_per_batch:
            raise BadInput(
                f"minibatch = {self.minibatch}: it must be at most frames_per_batch = {self.frames_per_batch}",
                "give a smaller minibatch",
            )
        if self.anneal_frames is not None:
            check_counts(anneal_frames=self.anneal_frames)
            if self.target_kl is not None:
                raise BadInput(f"anneal_frames = {self.anneal_frames} beside target_kl = {self.target_kl}", "give one")


@dataclass(frozen=True, eq=False)
class PPO:
    """The pieces of PPO, each usable alone; :meth:`update` shows how they fit together.

    Args:
        policy: stochastic policy that writes ``"action_log_prob"``.
        inputs: what policy and critic see.
        loss: holds the policy and the critic.
        advantage: writes ``"advantage"`` and ``"value_target"``.
        buffer: holds one batch of the collector and deals it out without replacement.
        optimiser: over the loss's parameters.
        settings: the numbers that it was built with.
    """

    policy: ProbabilisticActor
    inputs: Inputs
    loss: ClipPPOLoss
    advantage: GAE
    buffer: ReplayBuffer
    optimiser: torch.optim.Optimizer
    settings: PPOSettings

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """One PPO pass over a collector's batch (N, T); returns the losses' means.

        Raises:
            BadInput: the batch lacks a key, one has another width than the networks were built for, a value is NaN or
                infinite, or the batch is smaller than a minibatch or larger than the buffer; nothing is learnt then.
        """
        data = selected(data, [*self.inputs.keys, *self.loss.in_keys, *map(after, self.inputs.keys)])
        least, most = self.buffer.batch_size, self.buffer.storage.max_size
        if not least <= data.numel() <= most:
            raise BadInput(
                f"a batch of {data.numel()} frames, for minibatches of {least} and a buffer of {most}",
                "build ppo with another minibatch or frames_per_batch, or collect other batches",
            )
        self.inputs.observe(data)
        if self.inputs.normalisation is not None:
            # The statistics have moved since the policy acted: ratios are those of what learns, not of what they did.
            data[LOG_PROB] = self._log_prob(data)
        data["next", "reward"] = (1 - self.settings.gamma) * data["next", "reward"]
        with torch.no_grad():
            data = self.advantage(data)
        self.buffer.empty()
        self.buffer.extend(data.reshape(-1))
        sums: dict[str, float] = defaultdict(float)
        steps = 0
        for _ in range(self.settings.epochs):
            for batch in self.buffer:
                heed()
                losses = self.loss(batch)
                self._step(sum(losses[name] for name in LOSSES))
                steps += 1
                for name in (*LOSSES, "kl_approx"):
                    sums[name] += float(losses[name].detach())
        means = {name: value / max(steps, 1) for name, value in sums.items()}
        if self.settings.target_kl is not None:
            self._pace(means["kl_approx"] / self.settings.target_kl)
        anneal(self.optimiser, self.settings, data.numel())
        return means

    def _pace(self, ratio: float) -> None:
        """Learn slower or faster, by the divergence in units of its target."""
        factor = 1 / PACE if ratio > 2 else PACE if ratio < 0.5 else 1.0
        for group in self.optimiser.param_groups:
            group["lr"] = min(max(factor * group["lr"], SLOWEST), FASTEST)

    def state_dict(self) -> dict[str, Any]:
        """Weights and optimiser state."""
        return {"loss": self.loss.state_dict(), "optimiser": self.optimiser.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`state_dict` gave."""
        load_exactly("loss", self.loss, state["loss"])
        self.optimiser.load_state_dict(state["optimiser"])

    @torch.no_grad()
    def _log_prob(self, data: TensorDictBase) -> torch.Tensor:
        return self.policy.get_dist(data.select(*self.policy.in_keys)).log_prob(data[self.loss.tensor_keys.action])

    def _step(self, total: torch.Tensor) -> None:
        total.backward()
        for network in (self.loss.actor_network_params, self.loss.critic_network_params):
            clip_grad_norm_(list(network.parameters()), self.settings.max_grad_norm)
        self.optimiser.step()
        self.optimiser.zero_grad()


def ppo(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    settings: PPOSettings = PPOSettings(),
    *,
    in_keys: Sequence[NestedKey] = KEYS,
) -> PPO:
    """PPO with a policy and a critic built from the specs of one world.

    Args:
        observation_spec: shape (O,), or a Composite that holds every key.
        action_spec: ``OneHot``, ``Categorical`` or ``Bounded``.
        settings: of networks, batches and loss.
        in_keys: what policy and critic see.

    Raises:
        BadInput: an action of another kind, or a key that the spec lacks.
    """
    inputs = inputs_of(observation_spec, in_keys, normalise=settings.normalise)
    policy = stochastic_policy(
        observation_spec,
        action_spec,
        settings.widths,
        activation=settings.activation,
        log_prob=True,
        inputs=inputs,
    )
    critic = state_value(observation_spec, settings.widths, activation=settings.activation, inputs=inputs)
    loss = ClipPPOLoss(
        policy,
        critic,
        clip_epsilon=settings.clip,
        entropy_coeff=settings.entropy,
        critic_coeff=1.0,
        normalize_advantage=True,
    )
    # A plain loop over T: the vectorised form splits episodes apart, which costs more than it saves below ~1000 steps.
    advantage = GAE(
        gamma=settings.gamma, lmbda=settings.lmbda, value_network=critic, vectorized=False, deactivate_vmap=True
    )
    buffer = ReplayBuffer(
        storage=LazyTensorStorage(settings.frames_per_batch, device=observation_spec.device or "cpu"),
        sampler=SamplerWithoutReplacement(drop_last=True),
        batch_size=settings.minibatch,
    )
    optimiser = torch.optim.Adam(loss.parameters(), lr=settings.learning_rate, eps=1e-5, fused=True)
    return PPO(policy, inputs, loss, advantage, buffer, optimiser, settings)
