"""Many plans in many worlds at once: B starts, K worlds and S candidates in one batch of a simulator.

x_{t+1} = f(theta_k, x_t, u_t^{bs}),   x_0 = x_0^b        M = B K S rollouts of H steps
"""

from __future__ import annotations

from typing import NamedTuple, cast

import torch
from jaxtyping import Bool, Float
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.simulators import Simulator


class Rollouts(NamedTuple):
    """M rollouts of H steps.

    Attributes:
        before, after: states of batch size (M, H).
        valid: False from the step on in which a world diverged.
    """

    before: TensorDictBase
    after: TensorDictBase
    valid: Bool[Tensor, "M H"]


def crossed(
    theta: Float[Tensor, "K P"], state: TensorDictBase, plans: Float[Tensor, "B S H U"]
) -> tuple[Tensor, TensorDictBase, Tensor]:
    """Parameters (M, P), states (M,) and plans (M, H, U) of every start under each of its plans in each world."""
    (B, S), K = plans.shape[:2], len(theta)
    thetas = theta[None, :, None].expand(B, K, S, -1).reshape(B * K * S, -1)
    states = cast(TensorDictBase, state[:, None].expand(B, K * S).reshape(-1))
    return thetas, states, plans[:, None].expand(B, K, S, *plans.shape[2:]).reshape(B * K * S, *plans.shape[2:])


def rolled_out(
    simulator: Simulator, theta: Float[Tensor, "M P"], state: TensorDictBase, commands: Float[Tensor, "M H U"]
) -> Rollouts:
    """M worlds under their commands, each held for ``dt``."""
    M, H = commands.shape[:2]
    times = simulator.dt * torch.arange(1, H + 1, dtype=torch.float64, device=simulator.device)
    inputs = TensorDict({"command": commands}, batch_size=(M, H), device=simulator.device)
    after = simulator.rollout(theta, state, inputs, times)
    valid = after.pop("valid")
    before = TensorDict(
        {
            key: torch.cat((first.to(path)[:, None], path[:, :-1]), dim=1)
            for key, path in after.items(True, True)
            if (first := state.get(key, None)) is not None
        },
        batch_size=(M, H),
        device=after.device,
    )
    return Rollouts(before, after, valid)
