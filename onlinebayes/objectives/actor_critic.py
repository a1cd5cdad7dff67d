"""Recurrent advantage actor-critic: policy and value are two heads of one network with a memory.

    h_t, c_t = LSTM(f(s_t), h_{t-1}, c_{t-1}),  zero where an episode begins
    pi(a | h_t),  V(h_t)
    minimise  - E[A_t log pi(a_t | h_t)] + c_v E[(V(h_t) - A_t - V_old(h_t))^2] - c H(pi)
    A_t = sum_k (gamma lambda)^k (R_{t+k} + gamma V(h_{t+k+1}) - V(h_{t+k})),      R = (1 - gamma) x reward

Mnih et al., Asynchronous Methods for Deep Reinforcement Learning (2016). All worlds step at once in place of its
asynchronous workers, and each batch gives one gradient step. With lambda = 1 the advantage is its return of at most T
steps, T the batch's; with a smaller one it is Schulman's generalised estimate.

The memory travels in the tensordict: the policy writes ``("next", "memory")``, and the environment carries it to the
next step. So an environment needs two transforms, which :meth:`ActorCritic.transforms` gives.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_
from torchrl.data import TensorSpec
from torchrl.envs import InitTracker, Transform
from torchrl.modules import ProbabilisticActor
from torchrl.objectives.value.functional import generalized_advantage_estimate

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
from onlinebayes.objectives.networks import action_head, mlp
from onlinebayes.objectives.recurrent_network import RecurrentNetwork
from onlinebayes.runs import BadInput, load_exactly

INIT = "is_init"
ENDS = [("next", name) for name in ("reward", "done", "terminated")]


@dataclass(frozen=True, kw_only=True)
class ActorCriticSettings:
    """Settings of a recurrent actor-critic.

    Raises:
        BadInput: a number with which nothing can be learnt.
    """

    normalise: bool = False
    """whether what is seen is normalised by its running mean and standard deviation"""
    width: int = 64
    """H, units of the memory and of the layer before it"""
    activation: type[nn.Module] = nn.Tanh
    """of the layer before the memory"""
    gamma: float = 0.99
    """discount factor of a step, at least 0 and below 1; the reward is multiplied by 1 - gamma"""
    lmbda: float = 0.95
    """lambda of the advantage, 0 to 1; 1 for returns of n steps, n the steps of a batch"""
    entropy: float = 0.01
    """c of the loss, 0 or more"""
    value: float = 0.5
    """c_v of the loss, 0 or more"""
    learning_rate: float = 1e-3
    """Adam's, above 0"""
    anneal_frames: int | None = None
    """frames over which the learning rate falls in a line to zero; it stays without it"""
    max_grad_norm: float = 0.5
    """bound on the gradient's norm; above 0, infinite for none"""

    def __post_init__(self) -> None:
        check_discount(self.gamma)
        check_layers((), self.activation)
        check_counts(width=self.width)
        check_shares(lmbda=self.lmbda)
        check_weights(entropy=self.entropy, value=self.value)
        check_positive(learning_rate=self.learning_rate)
        check_bound_on_gradients(self.max_grad_norm)
        if self.anneal_frames is not None:
            check_counts(anneal_frames=self.anneal_frames)


@dataclass(frozen=True, eq=False)
class ActorCritic:
    """The pieces of a recurrent actor-critic, each usable alone; :meth:`update` shows how they fit together.

    Args:
        policy: stochastic policy that also writes the value and the next memory.
        network: its network.
        optimiser: over the network.
        action_key: of the action.
        settings: the numbers that it was built with.
    """

    policy: ProbabilisticActor
    network: RecurrentNetwork
    optimiser: torch.optim.Optimizer
    action_key: NestedKey
    settings: ActorCriticSettings

    @property
    def inputs(self) -> Inputs:
        """The inputs of the network."""
        return self.network.inputs

    def transforms(self) -> list[Transform]:
        """For the environment: where episodes begin, and an empty memory there."""
        return [InitTracker(INIT), self.network.make_tensordict_primer()]

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """One gradient step on a collector's batch (N, T); returns the losses.

        Raises:
            BadInput: the batch lacks a key, one has another width than the network was built for, or a value is NaN or
                infinite; nothing was learnt from the batch.
        """
        data = self._learnt_from(data)
        self.inputs.observe(data)
        losses = self._losses(data)
        self.optimiser.zero_grad()
        value, entropy = self.settings.value, self.settings.entropy
        total = losses["loss_policy"] + value * losses["loss_value"] + entropy * losses["loss_entropy"]
        total.backward()
        norm = clip_grad_norm_(self.network.parameters(), self.settings.max_grad_norm)
        self.optimiser.step()
        anneal(self.optimiser, self.settings, data.numel())
        return {**{name: float(loss.detach()) for name, loss in losses.items()}, "grad_norm": float(norm)}

    def losses(self, data: TensorDictBase) -> dict[str, Tensor]:
        """The three losses of a batch (N, T), as scalars with gradients.

        Raises:
            BadInput: as :meth:`update`.
        """
        return self._losses(self._learnt_from(data))

    def _learnt_from(self, data: TensorDictBase) -> TensorDictBase:
        """The part of a batch that is read, checked."""
        keys = [*self.inputs.keys, *map(after, self.inputs.keys), self.network.memory_key, INIT, self.action_key, *ENDS]
        if data.ndim != 2:
            raise BadInput(f"a batch of shape {tuple(data.batch_size)}", "give whole rows (N, T) in the order of time")
        return selected(data, keys)

    def _losses(self, data: TensorDictBase) -> dict[str, Tensor]:
        out, then = self.network.unroll(
            self.inputs.read(data),
            self.inputs.read(data, ("next",)),
            data[INIT].squeeze(-1),
            data[self.network.memory_key][:, 0],
        )
        told = self.network.policy(out)
        told = told if isinstance(told, tuple) else (told,)
        value, (reward, done, terminated) = self.network.value(out), (data[key] for key in ENDS)
        with torch.no_grad():
            advantage, target = generalized_advantage_estimate(
                self.settings.gamma,
                self.settings.lmbda,
                value.detach(),
                self.network.value(then),
                (1 - self.settings.gamma) * reward.to(value),
                done,
                terminated,
            )
        distribution = self.policy[-1].get_dist(
            TensorDict(dict(zip(self.policy[-1].in_keys, told, strict=True)), batch_size=data.batch_size)
        )
        log_prob = distribution.log_prob(data[self.action_key])
        return {
            "loss_policy": -(log_prob * _standardised(advantage).squeeze(-1)).mean(),
            "loss_value": (value - target).square().mean(),
            "loss_entropy": -_entropy(distribution).mean(),
        }

    def state_dict(self) -> dict[str, Any]:
        """Weights, statistics and optimiser state."""
        return {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from what :meth:`state_dict` gave."""
        load_exactly("network", self.network, state["network"])
        self.optimiser.load_state_dict(state["optimiser"])


def actor_critic(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    settings: ActorCriticSettings = ActorCriticSettings(),
    *,
    in_keys: Sequence[NestedKey] = KEYS,
    memory_key: NestedKey = "memory",
    action_key: NestedKey = "action",
) -> ActorCritic:
    """A recurrent actor-critic built from the specs of one world.

    Args:
        observation_spec: shape (O,), or a Composite that holds every key.
        action_spec: ``OneHot``, ``Categorical`` or ``Bounded``.
        settings: of network and loss.
        in_keys: what the network sees; add the last action or reward if the task asks for it.
        memory_key: of the memory (2, H) in the tensordict.
        action_key: where the action goes.

    Raises:
        BadInput: an action of another kind, or a key that the spec lacks.
    """
    inputs, device = inputs_of(observation_spec, in_keys, normalise=settings.normalise), observation_spec.device
    head, width, activation = action_head(action_spec), settings.width, settings.activation
    body = nn.Sequential(mlp(width, head.outputs, (), activation, device), *head.modules)
    network = RecurrentNetwork(inputs, width, body, activation, memory_key, device)
    module = TensorDictModule(network, [*inputs.keys, INIT, memory_key], [*head.keys, "state_value", after(memory_key)])
    policy = head.actor(module, action_spec, action_key=action_key)
    optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate, eps=1e-5, fused=True)
    return ActorCritic(policy, network, optimiser, action_key, settings)


def _standardised(advantage: Tensor) -> Tensor:
    return (advantage - advantage.mean()) / (advantage.std() + 1e-6)


def _entropy(distribution: torch.distributions.Distribution) -> Tensor:
    try:
        return distribution.entropy()
    except NotImplementedError:  # a squashed normal has none in closed form: one draw each
        return -distribution.log_prob(distribution.rsample())
