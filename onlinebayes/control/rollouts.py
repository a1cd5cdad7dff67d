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


def starts(
    simulator: Simulator, theta: Float[Tensor, "K P"], state: TensorDictBase, past: Float[Tensor, "B L U"]
) -> TensorDict:
    """The states (B, K) that plans start from: each of B states in each of K worlds.

    An observation does not tell what commands are still on their way (see ``actuator_delay``). So the last L commands
    are repeated in each world, and what the input stages of effects remember of them is a part of the state.

    Args:
        simulator, theta: the worlds.
        state: of B environments.
        past: their last commands, oldest first.
    """
    B, K = len(past), len(theta)
    starts = cast(TensorDict, state.apply(lambda x: x.repeat_interleave(K, 0), batch_size=(B * K,)))
    stages = [e for e in getattr(simulator, "effects", ()) if e.has_command and e.remembers]
    if stages and "effects" not in state:
        again = rolled_out(simulator, theta.repeat(B, 1), starts, past.repeat_interleave(K, 0)).after[:, -1]
        for effect in stages:
            starts["effects", effect.key] = again["effects", effect.key]
    return starts.reshape(B, K)


def crossed(
    theta: Float[Tensor, "K P"], state: TensorDictBase, plans: Float[Tensor, "B S H U"]
) -> tuple[Tensor, TensorDictBase, Tensor]:
    """Parameters (M, P), states (M,) and plans (M, H, U) of every start (B, K) under each of its plans."""
    (B, S), K = plans.shape[:2], len(theta)
    thetas = theta[None, :, None].expand(B, K, S, -1).reshape(B * K * S, -1)

    def each(x: Tensor) -> Tensor:
        return x.flatten(0, 1).repeat_interleave(S, 0)

    states = cast(TensorDict, state.apply(each, batch_size=(B * K * S,)))
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
