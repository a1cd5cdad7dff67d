"""Deep deterministic policy gradient, with goals told in hindsight where there are any.

    y = clip(R + gamma^m (1 - terminated) Q'(s_m, pi'(s_m))),      R the return of m <= n steps
    Q follows y,   pi climbs Q,   Q' and pi' follow with rate tau
    acting:  with probability epsilon a uniformly random action, else pi(s) + sigma N(0, 1) in units of the bounds

Lillicrap et al., Continuous Control with Deep Reinforcement Learning (2016); Andrychowicz et al., Hindsight Experience
Replay (2017), whose exploration, clip and action penalty are the defaults. The losses stand in ``deterministic_loss``,
the replay in ``hindsight``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import torch
from jaxtyping import Float
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Bounded, TensorSpec
from torchrl.envs.utils import ExplorationType, exploration_type

from onlinebayes.objectives.checks import check_bounds, check_numbers
from onlinebayes.objectives.deterministic_loss import DeterministicLoss
from onlinebayes.objectives.hindsight import EpisodeReplay, Hindsight
from onlinebayes.objectives.inputs import KEYS, Inputs, after, inputs_of, selected
from onlinebayes.objectives.networks import Network, mlp, unsupported
from onlinebayes.objectives.targets import Follower
from onlinebayes.runs import BadInput, load_exactly


class Scaled(nn.Module):
    """Actions in units of their bounds, -1 .. 1, to actions between ``low`` and ``high`` (A,)."""

    centre: Tensor
    halfwidth: Tensor

    def __init__(self, low: Float[Tensor, " A"], high: Float[Tensor, " A"]) -> None:
        super().__init__()
        self.register_buffer("centre", (high + low) / 2, persistent=False)
        self.register_buffer("halfwidth", (high - low) / 2, persistent=False)

    def forward(self, unit: Float[Tensor, "*batch A"]) -> Float[Tensor, "*batch A"]:
        """The action."""
        return self.centre + self.halfwidth * unit


@final
class Exploration(nn.Module):
    """Disturb an action under ``ExplorationType.RANDOM`` only, which collectors set.

    Args:
        low, high: the action's bounds (A,).
        epsilon: probability of a uniformly random action.
        noise: standard deviation of what is added otherwise, in half widths of the bounds.
    """

    low: Tensor
    high: Tensor

    def __init__(
        self, low: Float[Tensor, " A"], high: Float[Tensor, " A"], epsilon: float = 0.3, noise: float = 0.2
    ) -> None:
        super().__init__()
        self.register_buffer("low", low.clone(), persistent=False)
        self.register_buffer("high", high.clone(), persistent=False)
        self.epsilon, self.noise = epsilon, noise

    def forward(self, action: Float[Tensor, "*batch A"]) -> Float[Tensor, "*batch A"]:
        """An action within the bounds."""
        if exploration_type() is not ExplorationType.RANDOM:
            return action
        width = self.high - self.low
        near = action + self.noise * width / 2 * torch.randn_like(action)
        anywhere = self.low + width * torch.rand_like(action)
        at_random = torch.rand_like(action[..., :1]) < self.epsilon
        return torch.where(at_random, anywhere, near.clamp(self.low, self.high))


@dataclass(frozen=True, eq=False)
class DDPG:
    """The pieces of DDPG, each usable alone; :meth:`update` shows how they fit together.

    Args:
        policy: deterministic policy, followed by its exploration.
        inputs: what policy and critic see.
        loss: holds actor, critic and their targets.
        target: moves the targets.
        buffer: episodes.
        optimiser: over what learns in the loss.
        frames_per_update: fresh frames for which one gradient step is taken.
    """

    policy: TensorDictModuleBase
    inputs: Inputs
    loss: DeterministicLoss
    target: Follower
    buffer: EpisodeReplay
    optimiser: torch.optim.Optimizer
    frames_per_update: int

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """Remember a collector's batch (N, T) and take its share of gradient steps; returns the losses' means.

        Hindsight sees the more, the more of its episodes a batch holds whole.

        Raises:
            BadInput: a key is missing, or a value is NaN or infinite; nothing was learnt from the batch.
        """
        rows = self._remember(data, self.buffer.extend)
        steps = max(1, rows.numel() // self.frames_per_update)
        sums: dict[str, Any] = defaultdict(float)
        for _ in range(steps):
            for name, value in self.step().items():
                sums[name] += value
        return {name: float(value) / steps for name, value in sums.items()}

    def demonstrate(self, data: TensorDictBase) -> None:
        """Remember a batch (N, T) that somebody else acted in, without learning from it yet.

        Raises:
            BadInput: as :meth:`update`.
        """
        self._remember(data, self.buffer.extend_demonstrations)

    def step(self) -> dict[str, Tensor]:
        """One gradient step on a minibatch of the buffer; the losses, detached."""
        losses = self.loss(self.buffer.sample())
        self.optimiser.zero_grad()
        (losses["loss_actor"] + losses["loss_value"]).backward()
        self.optimiser.step()
        self.target.step()
        return {name: losses[name].detach() for name in self.loss.out_keys}

    def state_dict(self) -> dict[str, Any]:
        """Weights, statistics, optimiser state and buffer."""
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

    def _remember(self, data: TensorDictBase, extend: Callable[[TensorDictBase], None]) -> TensorDictBase:
        """Check and remember a batch, let the statistics follow; its steps (n,) without padding.

        Goals count as they were wanted and, as minibatches tell them, as they were reached.
        """
        hindsight, mask_key = self.buffer.hindsight, self.buffer.mask_key
        needed = [*self.loss.in_keys, self.buffer.done_key]
        if hindsight is not None:
            needed += [after(hindsight.achieved_key), hindsight.desired_key]
        rows, mask = selected(data, needed), data.get(mask_key, None)
        extend(data.select(*needed, mask_key, strict=False))
        rows = rows.reshape(-1) if mask is None else rows[mask.reshape(data.batch_size)]
        self.inputs.observe(rows)
        if hindsight is not None:
            self.inputs.observe(rows.set(hindsight.desired_key, rows[after(hindsight.achieved_key)]))
        return rows


def ddpg(
    observation_spec: TensorSpec,
    action_spec: TensorSpec,
    *,
    in_keys: Sequence[NestedKey] = KEYS,
    action_key: NestedKey = "action",
    hindsight: Hindsight | None = None,
    exploration: nn.Module | None = None,
    normalise: bool = True,
    memory: int = 200_000,
    minibatch: int = 256,
    frames_per_update: int = 8,
    demonstrations: float = 0.0,
    widths: Sequence[int] = (256, 256, 256),
    activation: type[nn.Module] = nn.ReLU,
    gamma: float = 0.98,
    steps: int = 3,
    value_range: tuple[float, float] | None = None,
    action_penalty: float = 0.0,
    tau: float = 0.01,
    learning_rate: float = 1e-3,
) -> DDPG:
    """DDPG with an actor and a critic built from the specs of one world.

    Args:
        observation_spec: shape (O,), or a Composite that holds every key.
        action_spec: ``Bounded``, shape (A,).
        in_keys: what actor and critic see; with goals among them the desired one.
        action_key: where the action goes.
        hindsight: how goals are told anew; without it this is plain DDPG.
        exploration: action -> action, while data are collected; :class:`Exploration` without it.
        normalise: whether inputs are normalised by their running mean and variance.
        memory: steps kept; old ones are overwritten.
        minibatch: transitions of one gradient step.
        frames_per_update: fresh frames for which one gradient step is taken.
        demonstrations: share of a minibatch from demonstrations, once :meth:`DDPG.demonstrate` was given some.
        widths: units of the hidden layers.
        activation: between the layers.
        gamma: discount factor, below 1.
        steps: n, of a return.
        value_range: bounds of the critic's target; (-1 / (1 - gamma), 0) where rewards are -1 and 0.
        action_penalty: weight of the squared action, in units of its bounds.
        tau: share of actor and critic in their targets at each step.
        learning_rate: Adam's.

    Raises:
        BadInput: an action that is not bounded, a key that the spec lacks, a goal that the actor does not see, or a
            number that cannot be.
    """
    if not isinstance(action_spec, Bounded) or action_spec.ndim != 1:
        raise unsupported(action_spec, "Bounded (A,)")
    check_bounds(action_spec)
    counts = {"memory": memory, "minibatch": minibatch, "frames_per_update": frames_per_update, "steps": steps}
    check_numbers(gamma=gamma, positive={"tau": tau, "learning_rate": learning_rate}, counts=counts)
    if hindsight is not None and hindsight.desired_key not in in_keys:
        raise BadInput(f"in_keys = {list(in_keys)} has no {hindsight.desired_key!r}", "let the policy see its goal")
    inputs, device = inputs_of(observation_spec, in_keys, normalise=normalise), observation_spec.device
    width, low, high = action_spec.shape[-1], action_spec.space.low, action_spec.space.high
    actor = nn.Sequential(mlp(inputs.width, width, widths, activation, device), nn.Tanh())
    critic = mlp(inputs.width + width, 1, widths, activation, device)
    target = Follower(nn.ModuleList([actor, critic]), tau)
    policy = TensorDictSequential(
        TensorDictModule(Network(inputs, nn.Sequential(actor, Scaled(low, high))), list(inputs.keys), [action_key]),
        TensorDictModule(exploration or Exploration(low, high), [action_key], [action_key]),
    )
    loss = DeterministicLoss(
        inputs,
        actor,
        critic,
        target.network,
        low,
        high,
        gamma=gamma,
        value_range=value_range,
        action_penalty=action_penalty,
        action_key=action_key,
    )
    learning = [weight for weight in loss.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(learning, lr=learning_rate, fused=True)
    buffer = EpisodeReplay(
        memory,
        minibatch,
        gamma=gamma,
        steps=steps,
        hindsight=hindsight,
        demonstrations=demonstrations,
        device=device,
    )
    return DDPG(policy, inputs, loss, target, buffer, optimiser, frames_per_update)
