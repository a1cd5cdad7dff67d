"""Deep deterministic policy gradient, with goals told in hindsight where there are any.

    y = clip(R + gamma^m (1 - terminated) Q'(s_m, pi'(s_m))),      R the return of m <= n steps
    Q follows y,   pi climbs Q,   Q' and pi' follow with rate tau
    acting:  with probability epsilon a uniformly random action, else pi(s) + sigma N(0, 1) in units of the bounds

Lillicrap et al., Continuous Control with Deep Reinforcement Learning (2016); Andrychowicz et al., Hindsight Experience
Replay (2017), whose exploration is the default. The losses stand in ``deterministic_loss``, the replay in
``hindsight``, the way of acting in ``exploration``.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from tensordict import NestedKey, TensorDictBase
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor, nn
from torchrl.data import Bounded, TensorSpec

from onlinebayes.objectives.annealing import anneal
from onlinebayes.objectives.checks import (
    check_bounds,
    check_counts,
    check_discount,
    check_layers,
    check_positive,
    check_rate_of_targets,
    check_shares,
    check_weights,
)
from onlinebayes.objectives.deterministic_loss import DeterministicLoss
from onlinebayes.objectives.exploration import Exploration
from onlinebayes.objectives.hindsight import EpisodeReplay, Hindsight
from onlinebayes.objectives.inputs import KEYS, Inputs, after, inputs_of, selected
from onlinebayes.objectives.networks import Network, Scaled, mlp, unsupported
from onlinebayes.objectives.targets import Follower
from onlinebayes.runs import BadInput, heed, load_exactly


@dataclass(frozen=True, kw_only=True)
class DDPGSettings:
    """Settings of DDPG.

    Raises:
        BadInput: a number with which nothing can be learnt.
    """

    normalise: bool = True
    """whether what is seen is normalised by its running mean and standard deviation"""
    widths: tuple[int, ...] = (256, 256, 256)
    """units of the hidden layers, of the actor and of the critic"""
    activation: type[nn.Module] = nn.ReLU
    """between the layers"""
    memory: int = 200_000
    """steps kept; old ones are overwritten"""
    minibatch: int = 256
    """transitions of one gradient step"""
    frames_per_update: int = 8
    """fresh frames for which one gradient step is taken"""
    demonstrations: float = 0.0
    """share of a minibatch from demonstrations, 0 to 1, once :meth:`DDPG.demonstrate` was given some"""
    gamma: float = 0.98
    """discount factor of a step, at least 0 and below 1"""
    steps: int = 3
    """n, the most steps of a return"""
    value_range: tuple[float, float] | None = None
    """bounds of the critic's target; (-1 / (1 - gamma), 0) where rewards are -1 and 0; none without it"""
    action_penalty: float = 0.0
    """weight of the squared action, in units of its bounds, in the actor's loss; 0 or more"""
    tau: float = 0.01
    """share of the gap to actor and critic that their targets close at each gradient step, above 0 and at most 1"""
    learning_rate: float = 1e-3
    """Adam's, above 0"""
    anneal_frames: int | None = None
    """frames over which the learning rate falls in a line to zero; it stays without it"""

    def __post_init__(self) -> None:
        check_discount(self.gamma)
        check_layers(self.widths, self.activation)
        counts = {"memory": self.memory, "minibatch": self.minibatch, "frames_per_update": self.frames_per_update}
        check_counts(**counts, steps=self.steps)
        check_shares(demonstrations=self.demonstrations)
        check_weights(action_penalty=self.action_penalty)
        check_rate_of_targets(self.tau)
        check_positive(learning_rate=self.learning_rate)
        if self.value_range is not None and not self.value_range[0] < self.value_range[1]:
            raise BadInput(f"value_range = {self.value_range}: the first must be below the second", "turn them round")
        if self.anneal_frames is not None:
            check_counts(anneal_frames=self.anneal_frames)


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
        settings: the numbers that it was built with.
    """

    policy: TensorDictModuleBase
    inputs: Inputs
    loss: DeterministicLoss
    target: Follower
    buffer: EpisodeReplay
    optimiser: torch.optim.Optimizer
    settings: DDPGSettings

    def update(self, data: TensorDictBase) -> dict[str, float]:
        """Remember a collector's batch (N, T) and take its share of gradient steps; returns the losses' means.

        Hindsight sees the more, the more of its episodes a batch holds whole.

        Raises:
            BadInput: a key is missing, or a value is NaN or infinite; nothing was learnt from the batch.
        """
        rows = self._remember(data, self.buffer.extend)
        steps = max(1, rows.numel() // self.settings.frames_per_update)
        sums: dict[str, Any] = defaultdict(float)
        for _ in range(steps):
            heed()
            for name, value in self.step().items():
                sums[name] += value
        anneal(self.optimiser, self.settings, rows.numel())
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
    settings: DDPGSettings = DDPGSettings(),
    *,
    in_keys: Sequence[NestedKey] = KEYS,
    action_key: NestedKey = "action",
    hindsight: Hindsight | None = None,
    exploration: nn.Module | None = None,
) -> DDPG:
    """DDPG with an actor and a critic built from the specs of one world.

    Args:
        observation_spec: shape (O,), or a Composite that holds every key.
        action_spec: ``Bounded``, shape (A,).
        settings: of networks, memory and loss.
        in_keys: what actor and critic see; with goals among them the desired one.
        action_key: where the action goes.
        hindsight: how goals are told anew; without it this is plain DDPG.
        exploration: action -> action, while data are collected; :class:`Exploration` without it.

    Raises:
        BadInput: an action that is not bounded, a key that the spec lacks, or a goal that the actor does not see.
    """
    if not isinstance(action_spec, Bounded) or action_spec.ndim != 1:
        raise unsupported(action_spec, "Bounded (A,)")
    check_bounds(action_spec)
    if hindsight is not None and hindsight.desired_key not in in_keys:
        raise BadInput(f"in_keys = {list(in_keys)} has no {hindsight.desired_key!r}", "let the policy see its goal")
    inputs, device = inputs_of(observation_spec, in_keys, normalise=settings.normalise), observation_spec.device
    width, low, high = action_spec.shape[-1], action_spec.space.low, action_spec.space.high
    actor = nn.Sequential(mlp(inputs.width, width, settings.widths, settings.activation, device), nn.Tanh())
    critic = mlp(inputs.width + width, 1, settings.widths, settings.activation, device)
    target = Follower(nn.ModuleList([actor, critic]), settings.tau)
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
        gamma=settings.gamma,
        value_range=settings.value_range,
        action_penalty=settings.action_penalty,
        action_key=action_key,
    )
    learning = [weight for weight in loss.parameters() if weight.requires_grad]
    optimiser = torch.optim.Adam(learning, lr=settings.learning_rate, fused=True)
    buffer = EpisodeReplay(
        settings.memory,
        settings.minibatch,
        gamma=settings.gamma,
        steps=settings.steps,
        hindsight=hindsight,
        demonstrations=settings.demonstrations,
        device=device,
    )
    return DDPG(policy, inputs, loss, target, buffer, optimiser, settings)
