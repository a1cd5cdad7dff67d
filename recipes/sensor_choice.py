"""Parts that recipe and study of the sensor choice share: episodes, the actor-critic's training, accuracy over use.

    accuracy(u) = acc_motion + mean over seconds of a (q - m),     a = 1 in the u N seconds that rank highest

q how often vision is right in a second, m whether motion is. A policy is conditioned on lambda and on the cost of a
second of camera, so that one training serves every trade-off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.envs import Compose, TransformedEnv

from envs.egocentric import CURRENTS, CameraCost, Phone, SensorChoice, Sequences, Stretches, features
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import ActorCritic, ActorCriticSettings, actor_critic
from onlinebayes.runs import Progress
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.trainers import collector_of
from onlinebayes.transforms import ParameterRandomization

COSTS = torch.linspace(0.0, 2.0, 21)
"""Of a second of camera [reward], at which a policy is looked at."""


@dataclass(frozen=True)
class Training:
    """Amount of training of a policy.

    Args:
        worlds: episodes that are played at once.
        batches: each is one episode of every world, and one gradient step.
        learning_rate: of Adam at its highest; it rises and falls once.
    """

    worlds: int = 256
    batches: int = 120
    learning_rate: float = 5e-3


def folds(sequences: Sequences, number: int, generator: torch.Generator) -> Int[Tensor, "S T"]:
    """A fold for each sequence, the sequences of an activity spread over all folds."""
    fold = torch.empty_like(sequences.label)
    for k, label in enumerate(sequences.label.unique().tolist()):
        rows = (sequences.label == label).nonzero().squeeze(-1)
        fold[rows] = (torch.randperm(len(rows), generator=generator) + k) % number
    return fold[:, None].expand(sequences.signals.shape[:2])


def stretches(
    sequences: Sequences,
    log_probability: Float[Tensor, "S T 20"],
    vision_rate: Float[Tensor, " 20"],
    chosen: Bool[Tensor, "S T"],
) -> Stretches:
    """The chosen seconds as episodes: each run of seconds that follow each other in one sequence is one.

    Args:
        sequences: all of them.
        log_probability: what the motion predictor says.
        vision_rate: how often vision is right, for each activity.
        chosen: seconds that take part.
    """
    chosen, steps = chosen & sequences.there, chosen.shape[1]
    before = torch.nn.functional.pad(chosen, (1, 0))[:, :-1]
    sequence, start = (chosen & ~before).nonzero().unbind(-1)
    onward = torch.arange(steps) + start[:, None]
    inside = (onward < steps) & chosen[sequence[:, None], onward.clamp(max=steps - 1)]
    there = inside.long().cumprod(1).bool()
    second = onward.clamp(max=steps - 1)

    def cut(values: Tensor) -> Tensor:
        rows = values[sequence[:, None], second]
        return rows * there.view(*there.shape, *[1] * (rows.ndim - 2))

    right = log_probability.argmax(-1) == sequences.labels
    rate = vision_rate[sequences.labels]
    return Stretches(cut(features(sequences, log_probability)), cut(right), cut(rate), there.sum(1), sequence)


def learn(
    played: Stretches, training: Training, seed: int, watch: Callable[[TensorDictBase], object] = lambda batch: None
) -> ActorCritic:
    """Train the recurrent actor-critic on the reward of Eq 3.1, for every lambda in [0, 1] and every cost in [0, 2].

    Args:
        played: what episodes are made of.
        training: for how long.
        seed: of worlds, weights and actions.
        watch: is shown each batch.
    """
    torch.manual_seed(seed)
    env = TransformedEnv(
        SimulatorEnv(Phone(training.worlds), SensorChoice(played), seed=seed),
        Compose(ParameterRandomization(BoxUniform(CURRENTS)), CameraCost()),
    )
    env.set_seed(seed)
    specs = env.observation_spec_unbatched, env.action_spec_unbatched
    # What is done now changes no later reward: a short horizon only takes noise from the advantage.
    learning = ActorCriticSettings(gamma=0.5, learning_rate=training.learning_rate)
    objective = actor_critic(*specs, learning, in_keys=["observation", "cost"])
    for transform in objective.transforms():
        env.append_transform(transform)
    rate = torch.optim.lr_scheduler.OneCycleLR(
        objective.optimiser, training.learning_rate, total_steps=training.batches + 1
    )
    collector = collector_of(env, objective.policy, played.features.shape[1])
    with Progress("learning to choose", training.batches) as progress:
        for k in range(1, training.batches + 1):
            if (batch := collector.next()) is None:
                break
            objective.update(batch)
            rate.step()
            watch(batch)
            progress.update(k)
    return objective


@torch.no_grad()
def leaning(objective: ActorCritic, seen: Stretches, trade_off: float, cost: float) -> Float[Tensor, "E T"]:
    """log pi(vision) - log pi(motion) in every second: above zero the policy asks the camera."""
    rows, steps, _ = seen.features.shape
    told = torch.tensor([trade_off, cost]).expand(rows, steps, 2)
    row = torch.cat([seen.features, told], -1)
    network, begins = objective.network, torch.zeros(rows, steps, dtype=torch.bool)
    out, _ = network.unroll(row, row, begins, torch.zeros(rows, 2, network.width))
    logits = network.policy(out)
    logits = logits[0] if isinstance(logits, tuple) else logits
    return logits[..., 1] - logits[..., 0]


def attachment(objective: ActorCritic, seen: Stretches) -> Float[Tensor, "E T"]:
    """Measure how long the policy keeps the camera while its cost rises: its probability, averaged over the costs.

    At lambda = 1, where the reward is accuracy less cost. It ranks the seconds for every share of use.
    """
    return torch.stack([leaning(objective, seen, 1.0, cost).sigmoid() for cost in COSTS.tolist()]).mean(0)


def outcome(seen: Stretches, camera: Bool[Tensor, "E T"]) -> tuple[float, float]:
    """Share of seconds in which the camera is asked, and expected accuracy."""
    there = seen.there
    right = torch.where(camera, seen.vision_rate, seen.motion_right.float())
    return float(camera[there].float().mean()), float(right[there].mean())


def accuracy_at(seen: Stretches, score: Float[Tensor, "E T"], uses: Sequence[float]) -> Float[Tensor, " U"]:
    """Expected accuracy where the camera is asked in the seconds of the highest score, a given share of all."""
    there = seen.there
    better = (seen.vision_rate - seen.motion_right.float())[there]
    order = score[there].argsort(descending=True, stable=True)
    total = torch.nn.functional.pad(better[order].cumsum(0), (1, 0)) / len(order)
    place = (torch.tensor(uses) * len(order)).round().long()
    return seen.motion_right[there].float().mean() + total[place]


def mixed(seen: Stretches, uses: Sequence[float]) -> Float[Tensor, " U"]:
    """Accuracy of who asks the camera in a share of the seconds without looking."""
    there = seen.there
    motion, vision = seen.motion_right[there].float().mean(), seen.vision_rate[there].mean()
    return motion + (vision - motion) * torch.tensor(uses)
