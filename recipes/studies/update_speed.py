"""How long one gradient step takes, sampling included: ``make update-speed`` -> docs/results/update-speed.json and .md.

| objective | networks                                      | batch |
|-----------|-----------------------------------------------|-------|
| SAC       | policy and two critics, 64 x 64               | 256   |
| DDPG      | actor and critic, 3 x 256, goals in hindsight | 256   |

Each stands beside the same by hand in torch, and beside TorchRL's loss, target update and replay buffer.
The code by hand knows nothing but tensors: rows in preallocated tensors, plain modules, Adam with fused kernels, one
lerp for all target weights. It is the least that the algorithm costs. All run in turn on one thread, and CPU time is
counted, so that other processes disturb little.
"""

from __future__ import annotations

import copy
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModule, TensorDictSequential
from torch import Tensor, nn
from torch.nn.functional import mse_loss, softplus
from torchrl.data import Bounded, Composite, HERReplayBuffer, LazyTensorStorage, ReplayBuffer, Unbounded
from torchrl.envs import CatTensors
from torchrl.modules import MLP, ValueOperator
from torchrl.objectives import DDPGLoss, SACLoss, SoftUpdate

from onlinebayes.experiments import status
from onlinebayes.objectives import DDPGSettings, Hindsight, SACSettings, ddpg, sac, stochastic_policy
from onlinebayes.runs import Progress, ResultTable, seed_everything
from recipes.studies.timing import Pairs, alternate, median, spread

Step = Callable[[], object]
B, OBS, G, A = 256, 10, 3, 4  # rows of a batch; values of an observation, a goal and an action
EPISODES, T = 100, 50
KEYS = ("observation", "desired_goal")


@dataclass
class Settings:
    """What is measured and for how long."""

    steps: int = 10
    """gradient steps of one measurement"""
    pairs: int = 41
    """pairs of measurements"""
    goal: float = 1.3
    """times the code by hand"""
    seed: int = 0
    """of weights and data"""
    out: str = "docs/results"
    """folder of update-speed.json and update-speed.md"""


def reward(achieved: Tensor, desired: Tensor) -> Tensor:
    """-1 until the goal is near."""
    return ((achieved - desired).norm(dim=-1) < 0.05).float() - 1


def episodes() -> TensorDict:
    """Random episodes (EPISODES, T) with goals, as a collector gives them."""
    observation = torch.randn(EPISODES, T + 1, OBS)
    place = 0.02 * torch.randn(EPISODES, T + 1, G).cumsum(1)
    goal = torch.randn(EPISODES, 1, G).expand(-1, T, -1)
    done = torch.zeros(EPISODES, T, 1, dtype=torch.bool)
    done[:, -1] = True
    told = {"observation": observation[:, :-1], "achieved_goal": place[:, :-1], "desired_goal": goal}
    following = {"observation": observation[:, 1:], "achieved_goal": place[:, 1:], "desired_goal": goal}
    ends = {"done": done, "truncated": done.clone(), "terminated": torch.zeros_like(done)}
    following |= {"reward": reward(place[:, 1:], goal).unsqueeze(-1), **ends}
    action = 2 * torch.rand(EPISODES, T, A) - 1
    return TensorDict({**told, "action": action, "next": following}, (EPISODES, T)).contiguous()


def network(inputs: int, outputs: int, widths: tuple[int, ...], *last: nn.Module) -> nn.Sequential:
    """A perceptron of plain modules."""
    layers: list[nn.Module] = []
    for width in widths:
        layers += [nn.Linear(inputs, width), nn.ReLU()]
        inputs = width
    return nn.Sequential(*layers, nn.Linear(inputs, outputs), *last)


def twin(of: nn.ModuleList) -> tuple[nn.ModuleList, list[Tensor], list[Tensor]]:
    """A target network, its weights and those it follows."""
    target = copy.deepcopy(of).requires_grad_(False)
    return target, list(target.parameters()), list(of.parameters())


# --- SAC ------------------------------------------------------------------------------------------------------------


def sac_by_hand(data: TensorDict) -> Step:
    """Soft actor-critic on tensors."""
    rows = data.reshape(-1)
    s, a, r, s2 = (rows[key].clone() for key in ("observation", "action", ("next", "reward"), ("next", "observation")))
    end = rows["next", "terminated"].clone()
    actor = network(OBS, 2 * A, (64, 64))
    critics = nn.ModuleList([network(OBS + A, 1, (64, 64)) for _ in range(2)])
    targets, behind, ahead = twin(critics)
    log_alpha = nn.Parameter(torch.zeros(()))
    critic_weights = list(critics.parameters())
    optimiser = torch.optim.Adam([*actor.parameters(), *critic_weights, log_alpha], 1e-3, fused=True)

    def act(x: Tensor) -> tuple[Tensor, Tensor]:
        mean, log_sd = actor(x).chunk(2, -1)
        log_sd = log_sd.clamp(-5, 2)
        noise = torch.randn_like(mean)
        u = mean + log_sd.exp() * noise
        log_prob = -0.5 * noise.square() - log_sd - 0.5 * math.log(2 * math.pi)
        return u.tanh(), (log_prob - 2 * (math.log(2) - u - softplus(-2 * u))).sum(-1, keepdim=True)

    def step() -> None:
        i = torch.randint(len(s), (B,))
        x, x2, alpha = s[i], s2[i], log_alpha.detach().exp()
        with torch.no_grad():
            a2, log_prob = act(x2)
            both = torch.cat([x2, a2], -1)
            value = torch.minimum(targets[0](both), targets[1](both)) - alpha * log_prob
            y = r[i] + 0.99 * ~end[i] * value
        known = torch.cat([x, a[i]], -1)
        loss_q = mse_loss(critics[0](known), y) + mse_loss(critics[1](known), y)
        now, log_prob = act(x)
        both = torch.cat([x, now], -1)
        critics.requires_grad_(False)
        loss_actor = (alpha * log_prob - torch.minimum(critics[0](both), critics[1](both))).mean()
        critics.requires_grad_(True)
        loss_alpha = -(log_alpha * (log_prob.detach().mean() - A))
        optimiser.zero_grad()
        (loss_q + loss_actor + loss_alpha).backward()
        optimiser.step()
        with torch.no_grad():
            torch._foreach_lerp_(behind, ahead, 0.005)

    return step


def sac_of_ours(data: TensorDict) -> Step:
    """The library's."""
    objective = sac(Unbounded((OBS,)), Bounded(-1, 1, (A,)), SACSettings(minibatch=B, widths=(64, 64)))
    objective.buffer.extend(data.select(*objective.loss.in_keys).reshape(-1))
    return objective.step


def sac_of_torchrl(data: TensorDict) -> Step:
    """TorchRL's loss, target update and replay buffer."""
    policy = stochastic_policy(Unbounded((OBS,)), Bounded(-1, 1, (A,)), (64, 64), activation=nn.ReLU)

    def critic() -> ValueOperator:
        body = MLP(in_features=OBS + A, out_features=1, num_cells=[64, 64], activation_class=nn.ReLU)
        return ValueOperator(body, in_keys=["observation", "action"])

    loss = SACLoss(policy, [critic(), critic()], num_qvalue_nets=2, loss_function="l2", target_entropy=-A)
    loss.make_value_estimator(gamma=0.99)
    keys = ("observation", "action", ("next", "reward"), ("next", "terminated"), ("next", "done"))
    return _torchrl(loss, data.select(*keys, ("next", "observation")), 0.005, ("actor", "qvalue", "alpha"))


# --- DDPG -----------------------------------------------------------------------------------------------------------


def ddpg_by_hand(data: TensorDict) -> Step:
    """Deterministic policy gradient with hindsight on tensors."""
    widths = (256, 256, 256)
    s, a, goal = (data[key].clone() for key in ("observation", "action", "desired_goal"))
    s2, reached, r = (data["next", key].clone() for key in ("observation", "achieved_goal", "reward"))
    actor, critic = network(OBS + G, A, widths, nn.Tanh()), network(OBS + G + A, 1, widths)
    nets = nn.ModuleList([actor, critic])
    targets, behind, ahead = twin(nets)
    optimiser = torch.optim.Adam(nets.parameters(), 1e-3, fused=True)
    mean, sd = torch.zeros(OBS + G), torch.ones(OBS + G)

    def step() -> None:
        e, t = torch.randint(EPISODES, (B,)), torch.randint(T, (B,))
        later = t + (torch.rand(B) * (T - t)).long()
        g = torch.where(torch.rand(B, 1) < 0.8, reached[e, later], goal[e, t])
        told = torch.where((g == goal[e, t]).all(-1, keepdim=True), r[e, t], reward(reached[e, t], g).unsqueeze(-1))
        x = ((torch.cat([s[e, t], g], -1) - mean) / sd).clamp(-10, 10)
        x2 = ((torch.cat([s2[e, t], g], -1) - mean) / sd).clamp(-10, 10)
        with torch.no_grad():
            y = (told + 0.98 * targets[1](torch.cat([x2, targets[0](x2)], -1))).clamp(-50, 0)
        loss_q = mse_loss(critic(torch.cat([x, a[e, t]], -1)), y)
        action = actor(x)
        critic.requires_grad_(False)
        loss_actor = -critic(torch.cat([x, action], -1)).mean() + 0.1 * action.square().mean()
        critic.requires_grad_(True)
        optimiser.zero_grad()
        (loss_q + loss_actor).backward()
        optimiser.step()
        with torch.no_grad():
            torch._foreach_lerp_(behind, ahead, 0.05)

    return step


def ddpg_of_ours(data: TensorDict) -> Step:
    """The library's."""
    observed = Composite(observation=Unbounded((OBS,)), desired_goal=Unbounded((G,)))
    settings = DDPGSettings(minibatch=B, memory=EPISODES * T, value_range=(-50.0, 0.0), action_penalty=0.1, steps=1)
    objective = ddpg(observed, Bounded(-1, 1, (A,)), settings, in_keys=KEYS, hindsight=Hindsight(reward))
    objective.buffer.extend(data)
    return objective.step


def ddpg_of_torchrl(data: TensorDict) -> Step:
    """TorchRL's loss, target update and hindsight buffer, relabelling with the goal after the step."""
    # TorchRL's MLP joins several inputs by itself.
    actor_body, critic_body = (
        MLP(in_features=inputs, out_features=outputs, num_cells=[256] * 3, activation_class=nn.ReLU)
        for inputs, outputs in ((OBS + G, A), (OBS + G + A, 1))
    )
    actor = TensorDictModule(nn.Sequential(actor_body, nn.Tanh()), ["row"], ["action"])
    actor = TensorDictSequential(CatTensors(KEYS, "row", del_keys=False), actor)
    critic = ValueOperator(critic_body, in_keys=[*KEYS, "action"])
    loss = DDPGLoss(actor, critic, delay_actor=True, loss_function="l2")
    loss.make_value_estimator(gamma=0.98)

    def told(rows: TensorDict) -> Tensor:
        return reward(rows["next", "achieved_goal"], rows["desired_goal"]).unsqueeze(-1)

    storage = LazyTensorStorage(EPISODES * T + 1)  # its buffer fails once it is full
    buffer = HERReplayBuffer(told, storage=storage, batch_size=B, achieved_goal_key=("next", "achieved_goal"))
    return _torchrl(loss, data, 0.05, ("actor", "value"), buffer)


def _torchrl(
    loss: nn.Module, data: TensorDict, tau: float, names: tuple[str, ...], buffer: ReplayBuffer | None = None
) -> Step:
    buffer = buffer or ReplayBuffer(storage=LazyTensorStorage(EPISODES * T), batch_size=B)
    buffer.extend(data.reshape(-1))
    target, optimiser = SoftUpdate(loss, tau=tau), torch.optim.Adam(loss.parameters(), 1e-3, fused=True)

    def step() -> None:
        losses = loss(buffer.sample())
        optimiser.zero_grad()
        sum(losses[f"loss_{name}"] for name in names).backward()
        optimiser.step()
        target.step()

    return step


# --- measuring ------------------------------------------------------------------------------------------------------


def milliseconds(step: Step, steps: int) -> Callable[[], float]:
    """A measurement: CPU time of one step [ms]."""

    def measure() -> float:
        start = time.process_time()
        for _ in range(steps):
            step()
        return 1e3 * (time.process_time() - start) / steps

    return measure


def compare(table: ResultTable, name: str, ours: Pairs, torchrl: Pairs, goal: float) -> None:
    """The rows of one objective."""
    ratio = median(ours.ratios)
    table.add(f"{name}, by hand", median(ours.reference), spread=spread(ours.reference, 3), unit="ms")
    table.add(f"{name}, ours", median(ours.ours), spread=spread(ours.ours, 3), unit="ms")
    table.add(f"{name}, TorchRL", median(torchrl.ours), spread=spread(torchrl.ours, 3), unit="ms")
    table.add(
        f"{name}, ours over by hand",
        ratio,
        spread=spread(ours.ratios, 3),
        unit="times",
        goal=f"<= {goal:g}",
        holds=ratio <= goal,
    )
    table.add(f"{name}, TorchRL over by hand", median(torchrl.ratios), spread=spread(torchrl.ratios, 3), unit="times")


def main(settings: Settings) -> int:
    """Measure, print and write the table."""
    seed_everything(settings.seed)
    data = episodes()
    table = ResultTable("update-speed", "make update-speed", [settings.seed])
    contests = {
        "SAC": (sac_of_ours, sac_by_hand, sac_of_torchrl),
        "DDPG": (ddpg_of_ours, ddpg_by_hand, ddpg_of_torchrl),
    }
    with Progress("update-speed", len(contests)) as progress:
        for k, (name, builders) in enumerate(contests.items()):
            ours, hand, torchrl = (milliseconds(build(data), settings.steps) for build in builders)
            pairs = alternate(ours, hand, settings.pairs), alternate(torchrl, hand, max(settings.pairs // 4, 1))
            compare(table, name, *pairs, settings.goal)
            progress.update(k + 1, f"{name}: {median(pairs[0].ratios):.2f} times the code by hand")
    print(table.to_markdown())
    path = table.write(settings.out)
    print(f"CPU time of one gradient step, medians of {settings.pairs} alternating pairs on one thread; in {path}")
    return 0 if table.holds else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
