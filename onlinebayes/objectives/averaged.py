"""A network that explores by its weights and is judged by their running average.

    w' <- w' + rate (w - w')        after each gradient step

The weights of a deterministic policy move to and fro from step to step, and with them what it reaches; their average
does not. Polyak and Juditsky, Acceleration of Stochastic Approximation by Averaging (1992).
"""

from __future__ import annotations

from typing import final

from torch import Tensor, nn
from torchrl.envs.utils import ExplorationType, exploration_type

from onlinebayes.objectives.targets import Follower


@final
class Averaged(nn.Module):
    """Acts by a network under ``ExplorationType.RANDOM``, which collectors set, and by its average otherwise.

    Args:
        network: which learns.
        rate: share of the gap that a step closes.

    Attributes:
        average: the network with the average's weights; it learns nothing itself.
    """

    def __init__(self, network: nn.Module, rate: float) -> None:
        super().__init__()
        self._follower = Follower(network, rate)
        self.network, self.average = network, self._follower.network

    def step(self) -> None:
        """Follow, after a gradient step."""
        self._follower.step()

    def forward(self, row: Tensor) -> Tensor:
        """What the network makes of a row."""
        exploring = exploration_type() is ExplorationType.RANDOM
        output: Tensor = (self.network if exploring else self.average)(row)
        return output
