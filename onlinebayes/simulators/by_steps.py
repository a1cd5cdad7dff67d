"""A rollout by stepping a copy: for engines that can only step.

state_k = step applied (t_k - t_{k-1}) / dt times,   under row k of the inputs
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.runs import BadInput, heed
from onlinebayes.simulators.base import Simulator


def by_steps(
    simulator: Simulator,
    theta: Float[Tensor, "M P"],
    state: TensorDictBase,
    inputs: TensorDictBase,
    times: Float[Tensor, " T"],
) -> TensorDict:
    """Compute the result of :meth:`Simulator.rollout` by steps of other worlds; those of ``simulator`` do not change.

    Args:
        simulator: whose ``with_worlds``, ``reset``, ``step`` and ``failed`` are used.
        theta, state, inputs: as for :meth:`Simulator.rollout`.
        times: the same, a whole number of ``dt`` apart [s].

    Raises:
        BadInput: times that lie between two steps.
    """
    steps = torch.round(times / simulator.dt)
    if not torch.allclose(steps * simulator.dt, times.to(steps), rtol=0, atol=1e-6 * simulator.dt):
        raise BadInput(
            f"times between the steps of {type(simulator).__name__}",
            f"record at whole multiples of dt = {simulator.dt:g} s, or build it with a shorter dt",
        )
    worlds = simulator.with_worlds(len(theta))
    now, rows = worlds.reset(theta, state), []
    for k, held in enumerate(torch.diff(steps, prepend=steps.new_zeros(1)).long().tolist()):
        for _ in range(held):
            heed()
            now = worlds.step(inputs[:, k])
        rows.append(now.clone().set("valid", ~worlds.failed))
    return TensorDict.stack(rows, dim=1)
