"""Speed at which worlds are stepped: ``make bench`` -> docs/results/bench.json and bench.md.

CartPole: N worlds in one ``SimulatorEnv``, length and mass drawn anew per world at every reset, through a TorchRL
``Collector`` with a 2 x 64 policy that samples its actions, against one ``GymEnv("CartPole-v1")`` through the same
Collector with the same policy. Both count steps and reward and reset by themselves. The worlds are float32, the
precision of what the policy sees (and of Gymnasium's own vectorised CartPole); float64 stands beside without a goal.
The Hopper's half stands in ``speed_hopper``, a policy's in ``speed_policy``.

Run it on an idle machine: on a busy one two threads measure how long they wait for each other (``--threads 1`` then
tells more).
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.collectors import Collector
from torchrl.envs import EnvBase, GymEnv, TransformedEnv
from torchrl.modules import MLP, OneHotCategorical, ProbabilisticActor

from envs.cartpole import CartPole, CartPoleTask
from onlinebayes.experiments import status
from onlinebayes.runs import Progress, ResultTable, seed_everything
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.speed_hopper import Bench, hopper_rows
from recipes.studies.speed_policy import policy_rows
from recipes.studies.timing import PAIRS, alternate, median, rate, spread


@dataclass
class Settings:
    """Options of the measurements."""

    worlds: tuple[int, ...] = (2048, 4096, 8192)
    """numbers of CartPole worlds"""
    hoppers: int = 1024
    """number of Hopper worlds"""
    seconds: float = 1.0
    """of each measurement; a pair has two, a row seven pairs [s]"""
    threads: int = 2
    """of torch for CartPole, of MuJoCo for the Hopper"""
    goal: float = 400.0
    """times the frames/s of one GymEnv"""
    seed: int = 0
    """of weights, starts and parameters"""
    out: str = "docs/results"
    """folder of bench.json and bench.md"""


class ThesisPrior:
    """U[0.1, 1]^2 over length [m] and mass [kg], the prior of Online BayesSim's CartPole."""

    def __init__(self, dtype: torch.dtype) -> None:
        self.dtype = dtype

    def sample(self, shape: tuple[int, ...]) -> Tensor:
        """Draws (*shape, 2)."""
        return 0.1 + 0.9 * torch.rand(*shape, 2, dtype=self.dtype)


def worlds_env(worlds: int, seed: int, dtype: torch.dtype = torch.float32) -> EnvBase:
    """N CartPole worlds with length and mass of their own."""
    env = SimulatorEnv(CartPole(["length", "mass"], worlds, dtype=dtype), CartPoleTask(), seed=seed)
    return TransformedEnv(env, ParameterRandomization(ThesisPrior(dtype)))


def frames(env: EnvBase, steps: int, settings: Settings) -> Callable[[], float]:
    """A measurement: frames/s of a Collector over ``env``, ``steps`` a batch, with the policy of the bench."""
    seed_everything(settings.seed)
    net = MLP(4, 2, num_cells=[64, 64], activation_class=nn.ReLU)
    policy = ProbabilisticActor(
        TensorDictModule(net, in_keys=["observation"], out_keys=["logits"]),
        in_keys=["logits"],
        distribution_class=OneHotCategorical,
    )
    batch = env.batch_size.numel() * steps
    collector = Collector(
        env,
        policy,
        frames_per_batch=batch,
        total_frames=-1,
        trust_policy=True,
        track_traj_ids=False,
        auto_register_policy_transforms=False,
    )
    batches = iter(collector)

    def advance() -> int:
        data = next(batches)
        assert data.numel() == batch
        assert data["next", "reward"].numel() == batch
        return batch

    return lambda: rate(advance, settings.seconds)


def cartpole(table: ResultTable, settings: Settings) -> None:
    """The rows of CartPole; the goal is for float32."""
    reference = frames(GymEnv("CartPole-v1"), 250, settings)
    cases = [(worlds, dtype) for dtype in (torch.float32, torch.float64) for worlds in settings.worlds]
    with Progress("cartpole", len(cases)) as progress:
        for k, (worlds, dtype) in enumerate(cases):
            pairs = alternate(frames(worlds_env(worlds, settings.seed, dtype), 32, settings), reference)
            aimed = dtype == torch.float32
            name, ratio = f"CartPole, {worlds} worlds{'' if aimed else ', float64'}", median(pairs.ratios)
            if k == 0:
                one = pairs.reference
                table.add("CartPole-v1, one GymEnv", median(one), spread=spread(one), unit="frames/s")
            table.add(name, median(pairs.ours), spread=spread(pairs.ours), unit="frames/s")
            table.add(
                f"{name}, over one GymEnv",
                ratio,
                spread=spread(pairs.ratios, 3),
                unit="times",
                goal=f">= {settings.goal:g}" if aimed else None,
                holds=ratio >= settings.goal if aimed else None,
            )
            progress.update(k + 1, f"{name}: {ratio:.0f} times one GymEnv")


def main(settings: Settings) -> int:
    """Measure, print and write the table."""
    torch.set_num_threads(settings.threads)
    table = ResultTable("bench", "make bench", [settings.seed])
    table.add("threads", settings.threads)
    cartpole(table, settings)
    torch.set_num_threads(1)  # torch's idle threads spin for a while, on the cores that MuJoCo's threads need
    hopper_rows(table, Bench(settings.hoppers, settings.threads, settings.seconds, settings.seed))
    policy_rows(table, settings.seconds, settings.seed)
    print(table.to_markdown())
    path = table.write(settings.out)
    print(f"medians of {PAIRS} alternating pairs on {settings.threads} threads, spread from least to most; in {path}")
    return 0 if table.holds else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
