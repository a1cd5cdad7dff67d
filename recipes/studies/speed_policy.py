"""Time that a policy of 2 x 64 units takes for an action, in numpy and through its TensorDict modules."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.objectives import PPOSettings, exported, ppo
from onlinebayes.policies import NumpyPolicy, Origin, card_of
from onlinebayes.runs import ResultTable, seed_everything
from recipes.studies.timing import PAIRS, alternate, median, rate, spread

GOAL = 30.0
"""Most microseconds for an action in numpy."""


def policy_rows(table: ResultTable, seconds: float, seed: int) -> None:
    """The rows of a policy in use; both sides begin with the observation as an array.

    Args:
        table: gets them.
        seconds: of each measurement [s].
        seed: of weights and observation.
    """
    seed_everything(seed)
    seen, done = Composite(observation=Unbounded((12,))), Bounded(-1.0, 1.0, shape=(3,))
    policy = ppo(seen, done, PPOSettings(normalise=True)).policy
    network = exported(policy)
    light, row = NumpyPolicy(network, card_of(network, Origin("bench", {}))), torch.randn(12).numpy()

    def one() -> int:
        for _ in range(100):
            light.act(row)
        return 100

    def other() -> int:
        with set_exploration_type(ExplorationType.DETERMINISTIC), torch.no_grad():
            policy(TensorDict({"observation": torch.from_numpy(row)}, [])).get("action").numpy()
        return 1

    pairs = alternate(lambda: rate(one, seconds), lambda: rate(other, seconds), PAIRS)
    ours, reference = ([1e6 / each for each in side] for side in (pairs.ours, pairs.reference))
    holds = median(ours) <= GOAL
    name = "policy of 2 x 64 units, an action"
    table.add(name, median(ours), spread=spread(ours), unit="us", goal=f"<= {GOAL:g}", holds=holds)
    table.add(f"{name} by TensorDict", median(reference), spread=spread(reference), unit="us")
