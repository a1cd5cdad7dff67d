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

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import torch
from jaxtyping import Bool, Float
from tensordict import NestedKey, TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torch.nn.utils import clip_grad_norm_
from torchrl.data import Composite, TensorSpec, Unbounded
from torchrl.envs import InitTracker, TensorDictPrimer, Transform
from torchrl.modules import ProbabilisticActor
from torchrl.objectives.value.functional import generalized_advantage_estimate

from onlinebayes.objectives.checks import check_numbers
from onlinebayes.objectives.inputs import KEYS, Inputs, after, inputs_of, selected
from onlinebayes.objectives.networks import action_head, mlp
from onlinebayes.runs import BadInput, load_exactly

INIT = "is_init"
ENDS = [("next", name) for name in ("reward", "done", "terminated")]


@final
class RecurrentNetwork(nn.Module):
    """Inputs and memory -> what the policy's head says, the value, the next memory.

    Args:
        inputs: what is seen.
        width: H, units of the memory and of the layer before it.
        policy: (*batch, H) -> a distribution's parameters.
        activation: of the layer before the memory.
        memory_key: of the memory.
        device: of the weights.
    """

    def __init__(
        self,
        inputs: Inputs,
        width: int,
        policy: nn.Module,
        activation: type[nn.Module] = nn.Tanh,
        memory_key: NestedKey = "memory",
        device: torch.device | str | None = None,
    ) -> None:
        super().__init__()
        self.inputs, self.width, self.policy, self.memory_key = inputs, width, policy, memory_key
        self.encoder = nn.Sequential(nn.Linear(inputs.width, width, device=device), activation())
        self.lstm = nn.LSTM(width, width, batch_first=True, device=device)
        self.value = nn.Linear(width, 1, device=device)

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        """One step: observed values (*batch, _), then ``is_init`` (*batch, 1) and the memory (*batch, 2, H)."""
        *observed, begins, memory = values
        batch = memory.shape[:-2]
        row = self.inputs(*observed).reshape(-1, 1, self.inputs.width)
        memory = (memory * ~begins.unsqueeze(-1)).reshape(-1, 2, self.width)
        out, memory = self._run(self.encoder(row), memory)
        out = out.reshape(*batch, self.width)
        parameters = self.policy(out)
        parameters = parameters if isinstance(parameters, tuple) else (parameters,)
        return *parameters, self.value(out), memory.reshape(*batch, 2, self.width)

    def unroll(
        self,
        row: Float[Tensor, "N T F"],
        following: Float[Tensor, "N T F"],
        begins: Bool[Tensor, "N T"],
        memory: Float[Tensor, "N 2 H"],
    ) -> tuple[Float[Tensor, "N T H"], Float[Tensor, "N T H"]]:
        """What the heads see at each step of a batch, and at the state that follows each step.

        Args:
            row: what is seen.
            following: what is seen after the step, before a reset.
            begins: where an episode begins.
            memory: before the first step.
        """
        steps = row.shape[1]
        seen, outs, thens = self.encoder(row), [], []
        # Between two columns in which some world begins anew, the LSTM runs through without a look.
        edges = [0, *(begins[:, 1:].any(0).nonzero().flatten() + 1).tolist(), steps]
        for first, last in itertools.pairwise(edges):
            memory = memory * ~begins[:, first, None, None]
            out, memory = self._run(seen[:, first:last], memory)
            then, _ = self._run(self.encoder(following[:, last - 1 : last]), memory)
            outs.append(out)
            thens += [out[:, 1:], then]
        return torch.cat(outs, 1), torch.cat(thens, 1)

    def make_tensordict_primer(self) -> TensorDictPrimer:
        """The transform that gives worlds an empty memory at their reset."""
        empty = Unbounded((2, self.width), device=self.value.weight.device)
        primers = Composite()
        primers[self.memory_key] = empty
        return TensorDictPrimer(primers, default_value=0.0, expand_specs=True)

    def _run(self, seen: Float[Tensor, "B T H"], memory: Float[Tensor, "B 2 H"]) -> tuple[Tensor, Tensor]:
        hidden, cell = (part.unsqueeze(0).contiguous() for part in memory.unbind(1))
        out, (hidden, cell) = self.lstm(seen, (hidden, cell))
        return out, torch.stack([hidden[0], cell[0]], 1)


@dataclass(frozen=True, eq=False)
class ActorCritic:
    """The pieces of a recurrent actor-critic, each usable alone; :meth:`update` shows how they fit together.

    Args:
        policy: stochastic policy that also writes the value and the next memory.
        network: its network.
        optimiser: over the network.
        gamma: discount factor.
        lmbda: lambda of the advantage.
        entropy: c.
        value: c_v.
        reward_scale: factor on the reward, 1 - gamma as built by :func:`actor_critic`.
        max_grad_norm: bound on the gradient's norm.
        action_key: of the action.
    """

    policy: ProbabilisticActor
    network: RecurrentNetwork
    optimiser: torch.optim.Optimizer
    gamma: float
    lmbda: float
    entropy: float
    value: float
    reward_scale: float
    max_grad_norm: float
    action_key: NestedKey

    @property
    def inputs(self) -> Inputs:
        """What the network sees."""
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
        total = losses["loss_policy"] + self.value * losses["loss_value"] + self.entropy * losses["loss_entropy"]
        total.backward()
        norm = clip_grad_norm_(self.network.parameters(), self.max_grad_norm)
        self.optimiser.step()
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
                self.gamma,
                self.lmbda,
                value.detach(),
                self.network.value(then),
                self.reward_scale * reward.to(value),
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
    *,
    in_keys: Sequence[NestedKey] = KEYS,
    normalise: bool = False,
    width: int = 64,
    activation: type[nn.Module] = nn.Tanh,
    gamma: float = 0.99,
    lmbda: float = 0.95,
    entropy: float = 0.01,
    value: float = 0.5,
    learning_rate: float = 1e-3,
    max_grad_norm: float = 0.5,
    memory_key: NestedKey = "memory",
    action_key: NestedKey = "action",
) -> ActorCritic:
    """A recurrent actor-critic built from the specs of one world.

    Args:
        observation_spec: shape (O,), or a Composite that holds every key.
        action_spec: ``OneHot``, ``Categorical`` or ``Bounded``.
        in_keys: what the network sees; add the last action or reward if the task asks for it.
        normalise: whether that is normalised by its running mean and standard deviation.
        width: H, of the memory and of the layer before it.
        activation: of that layer.
        gamma: discount factor, below 1.
        lmbda: lambda of the advantage; 1 for returns of n steps, n the steps of a batch.
        entropy: c.
        value: c_v.
        learning_rate: Adam's.
        max_grad_norm: bound on the gradient's norm.
        memory_key: of the memory (2, H) in the tensordict.
        action_key: where the action goes.

    Raises:
        BadInput: an action of another kind, a key that the spec lacks, or a number that cannot be.
    """
    check_numbers(gamma=gamma, positive={"learning_rate": learning_rate}, counts={"width": width})
    inputs, device = inputs_of(observation_spec, in_keys, normalise=normalise), observation_spec.device
    head = action_head(action_spec)
    body = nn.Sequential(mlp(width, head.outputs, (), activation, device), *head.modules)
    network = RecurrentNetwork(inputs, width, body, activation, memory_key, device)
    module = TensorDictModule(network, [*inputs.keys, INIT, memory_key], [*head.keys, "state_value", after(memory_key)])
    policy = head.actor(module, action_spec, action_key=action_key)
    optimiser = torch.optim.Adam(network.parameters(), lr=learning_rate, eps=1e-5, fused=True)
    return ActorCritic(policy, network, optimiser, gamma, lmbda, entropy, value, 1 - gamma, max_grad_norm, action_key)


def _standardised(advantage: Tensor) -> Tensor:
    return (advantage - advantage.mean()) / (advantage.std() + 1e-6)


def _entropy(distribution: torch.distributions.Distribution) -> Tensor:
    try:
        return distribution.entropy()
    except NotImplementedError:  # a squashed normal has none in closed form: one draw each
        return -distribution.log_prob(distribution.rsample())
