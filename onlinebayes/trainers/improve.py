"""A policy learns from fresh batches of a collector, and gets up again where its losses are no numbers."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from typing import Protocol, runtime_checkable

from tensordict import TensorDictBase

from onlinebayes.objectives import Objective
from onlinebayes.runs import BadInput, heed

BUFFER = "buffer"
"""Key under which an objective's ``state_dict`` keeps its replay buffer."""


@runtime_checkable
class Batches(Protocol):
    """Fresh data without end, as a TorchRL ``Collector`` gives it."""

    def reset(self) -> None:
        """Begin a new episode in every world."""

    def next(self) -> TensorDictBase | None:
        """The next batch (N, T)."""


def improve(
    objective: Objective,
    collector: Batches,
    batches: int,
    after: Callable[[int, int, dict[str, float]], bool] | None = None,
    *,
    begin: int = 0,
    anew: bool = False,
) -> list[str]:
    """Let a policy learn from fresh episodes in the collector's worlds.

    Where losses are no numbers the objective goes back to where it stood at the beginning, and learns on from there.

    Args:
        objective: the policy that the collector runs, and its learning.
        collector: gives batches (N, T).
        batches: how many to learn from.
        after: told the number of batches so far, the frames of the last one and its losses; False ends it early.
        begin: batches that were learnt from before; with 0 the collector begins new episodes.
        anew: whether it begins them anyway.

    Returns:
        Notes on what went wrong.

    Raises:
        Stopped: the block in hand was asked to end; the batch in hand is lost, and a part of its learning.
        BadInput: the collector ended, or the losses are no numbers again and again.
    """
    if begin < batches and (anew or not begin):
        collector.reset()
    # The buffer is large and none of it is wrong: it stays.
    good = copy.deepcopy({key: part for key, part in objective.state_dict().items() if key != BUFFER})
    failures = 0
    for batch in range(begin + 1, batches + 1):
        data = collector.next()
        if data is None:
            raise BadInput(f"the collector ended after {batch - 1} of {batches} batches", "give it total_frames=-1")
        heed()  # the batch may have been cut short
        losses = objective.update(data)
        wrong = [name for name, value in losses.items() if not math.isfinite(value)]
        if wrong:
            failures += 1
            if failures == 3:
                raise BadInput(
                    f"{wrong[0]} was no number in three batches of one outer step",
                    "lower the learning rate, or look at the rewards and observations",
                )
            kept = {key: part for key, part in objective.state_dict().items() if key == BUFFER}
            objective.load_state_dict({**copy.deepcopy(good), **kept})
        if after is not None and not after(batch, data.numel(), losses):
            break
    note = f"a loss was no number in {failures} batches; the policy went back to where the step began"
    return [note] if failures else []
