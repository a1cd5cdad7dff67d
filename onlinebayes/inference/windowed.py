r"""Long trajectories cut into windows, which an estimator of sets reads side by side.

    x (T)  ->  x_1 ... x_K,  K = ceil(T / L),  L steps each;     q(theta | x) = q(theta | {x_1 ... x_K})

A filter walks through a trajectory step by step, so that its time grows with L and hardly with K. Each window begins
where a noisy observation says, which loses the little that the step across a cut tells. The same estimator then serves
in a loop, where the windows come one by one: it learns from sets of one to K.
"""

from __future__ import annotations

from typing import cast, final

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Generator, Tensor

from onlinebayes.inference.base import Belief, Density, FitReport, PosteriorEstimator
from onlinebayes.runs import BadInput


@final
class Windowed:
    """A :class:`~onlinebayes.inference.PosteriorEstimator` that cuts what it is given and hands it on.

    Args:
        estimator: of sets, such as one behind a ``FilteredEmbedding``.
        steps: of a window L.

    Raises:
        BadInput: windows without a step.
    """

    def __init__(self, estimator: PosteriorEstimator, steps: int) -> None:
        if steps < 1:
            raise BadInput(f"windows of {steps} steps", "a window has at least one step")
        self.estimator, self.steps = estimator, steps
        self.space, self.box = estimator.space, estimator.box

    def fit(
        self, simulations: TensorDictBase, groups: TensorDictBase | None = None, *, generator: Generator
    ) -> FitReport:
        """Learn from the windows of each trajectory as a set."""
        sets = _sets(windows(simulations, self.steps), len(simulations))
        each = None if groups is None else self._of_groups(groups)
        return self.estimator.fit(sets, each, generator=generator)

    def condition(self, trajectories: TensorDictBase) -> Belief:
        """Return the posterior given all windows of the trajectories (n, T)."""
        return self.estimator.condition(windows(trajectories, self.steps))

    def each(self, groups: TensorDictBase) -> Density:
        """One posterior for each group of trajectories (G, n, T)."""
        return self.estimator.each(self._of_groups(groups))

    def _of_groups(self, groups: TensorDictBase) -> TensorDictBase:
        return _sets(windows(cast(TensorDictBase, groups.flatten(0, 1)), self.steps), len(groups))


def windows(trajectories: TensorDictBase, steps: int) -> TensorDict:
    """The windows (n K, L) of trajectories (n, T), those of one side by side; the last one's missing steps masked."""
    number, length = trajectories.batch_size
    missing = -length % steps
    cut = trajectories.copy()
    if "mask" not in cut:
        cut["mask"] = torch.ones(number, length, dtype=torch.bool, device=cut.device)

    def part(value: Tensor) -> Tensor:
        padding = value.new_zeros(number, missing, *value.shape[2:])
        return torch.cat((value, padding), dim=1).reshape(-1, steps, *value.shape[2:])

    return cast(TensorDict, cut.apply(part, batch_size=[number * (length + missing) // steps, steps]))


def _sets(trajectories: TensorDict, number: int) -> TensorDictBase:
    """So many sets of equally many."""
    return trajectories.unflatten(0, (number, len(trajectories) // number))
