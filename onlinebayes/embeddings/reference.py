"""A simulator asked for one step from each observed state: what the features' residuals are taken against.

    g(o, a; theta_r) = observe(f(theta_r, state(o), command(a))),    r = 0 ... 2 P

theta_0 is a box's centre, the others lie on either side of it, two a parameter.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.simulators import Simulator


class SimulatorReference:
    """A :data:`~onlinebayes.embeddings.Reference` by a simulator.

    Args:
        simulator: gives the physics; only its ``rollout`` is used.
        points: theta (R, P) at which it is asked: the centre, or the centre and pairs around it
            (``box.cross()`` of ``onlinebayes.inference``) [units].
        state: observations (M, O) -> complete states of batch size (M,), the inverse of ``observe``.
        command: actions (M, A) -> commands (M, U).
        observe: states of batch size (M,) -> observations (M, O); a task's, if it gives one observation.
    """

    def __init__(
        self,
        simulator: Simulator,
        points: Float[Tensor, "R P"],
        *,
        state: Callable[[Tensor], TensorDictBase],
        command: Callable[[Tensor], Tensor],
        observe: Callable[[TensorDictBase], Any],
    ) -> None:
        self.simulator, self.points = simulator, points
        self.state, self.command, self.observe = state, command, observe

    def __deepcopy__(self, memo: dict[int, object]) -> SimulatorReference:
        """Itself: it has no state, and a copy of a compiled simulator would only cost memory."""
        return self

    def __call__(self, observation: Float[Tensor, "*batch O"], action: Float[Tensor, "*batch A"]) -> Tensor:
        """Next observations (R, *batch, O)."""
        rows, answers = observation.reshape(-1, observation.shape[-1]), len(self.points)
        dtype, device = self.simulator.dtype, self.simulator.device
        commands = self.command(action.reshape(len(rows), -1)).to(device, dtype)
        repeated = torch.cat([self.state(rows).to(device)] * answers)
        inputs = TensorDict({"command": commands.repeat(answers, 1).unsqueeze(1)}, batch_size=[answers * len(rows), 1])
        theta = self.points.to(device, dtype)
        times = torch.tensor([self.simulator.dt], dtype=torch.float64)
        after = self.simulator.rollout(theta.repeat_interleave(len(rows), 0), repeated, inputs, times)[:, 0]
        return self.observe(after).reshape(answers, *observation.shape)
