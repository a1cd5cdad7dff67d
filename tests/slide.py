"""A mass on a rail that a known force pushes: linear in its state and its parameters, seen by noisy sensors."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Unbounded

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, Task, TorchSimulator

STEP, STEPS = 0.1, 20


class Slide(TorchSimulator):
    """a = gain u + offset."""

    physical = ParameterSpace({"gain": Parameter(0.5, 2.5, "1/kg"), "offset": Parameter(-1.0, 1.0, "m/s2")})
    defaults = {"gain": 1.0, "offset": 0.0}  # noqa: RUF012
    joints = (Joint("rail", "slide"),)
    actuators = (Actuator("motor", "rail"),)
    timestep = STEP

    def acceleration(self, parameters: Mapping[str, Tensor], q: Tensor, v: Tensor, tau: Tensor) -> Tensor:
        return parameters["gain"] * tau + parameters["offset"]


class Watching(Task):
    """Position and velocity are observed; nothing is wanted."""

    observation_size, horizon = 2, STEPS
    action_spec = Unbounded((1,))

    def start(self, theta: Tensor, generator: torch.Generator) -> TensorDict:
        return state(torch.randn(len(theta), 2, dtype=torch.float64, generator=generator))

    def observe(self, state: TensorDictBase) -> Tensor:
        return observe(state)

    def command(self, action: Tensor) -> Tensor:
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Tensor:
        return torch.zeros(state.batch_size)

    def terminated(self, state: TensorDictBase) -> Tensor:
        return torch.zeros(state.batch_size, dtype=torch.bool)


def state(observation: Tensor) -> TensorDict:
    q, v = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": q, "qvel": v}, batch_size=observation.shape[:1])


def observe(state: TensorDictBase) -> Tensor:
    return torch.cat([state["qpos"], state["qvel"]], dim=-1)


def path(space: ParameterSpace, theta: Tensor, begin: Tensor, action: Tensor) -> Tensor:
    """Observations (B, T + 1, 2) without noise from where the mass begins (B, 2)."""
    times = STEP * torch.arange(1, action.shape[1] + 1, dtype=torch.float64)
    inputs = TensorDict({"command": action.double()}, batch_size=action.shape[:2])
    made = Slide(space).rollout(theta, state(begin), inputs, times)
    return torch.cat([begin[:, None], observe(made)], dim=1)


def measured(space: ParameterSpace, theta: Tensor, noise: Tensor, draw: torch.Generator) -> tuple[Tensor, Tensor]:
    """What noisy sensors see (B, T + 1, 2) of random forces (B, T, 1) from random starts."""
    B = len(theta)
    action = torch.randn(B, STEPS, 1, dtype=torch.float64, generator=draw)
    seen = path(space, theta, torch.randn(B, 2, dtype=torch.float64, generator=draw), action)
    return seen + noise * torch.randn(seen.shape, dtype=torch.float64, generator=draw), action


def least_squares(space: ParameterSpace, seen: Tensor, action: Tensor, noise: Tensor) -> tuple[Tensor, Tensor]:
    """Information (P, P) of one trajectory (T + 1, 2) about z in the space's unit cube, and information times z.

    All starts are possible: they are taken out of the rows, which are in units of noise.
    """
    P, low, rest = len(space), space.low[None].double(), torch.zeros(1, 2).double()
    width = (space.high - space.low).double()
    c = path(space, low, rest, action[None])[0]
    starts = [path(space, low, row[None], action[None])[0] - c for row in torch.eye(2).double()]
    slopes = [path(space, low + row * width, rest, action[None])[0] - c for row in torch.eye(P).double()]
    A, N = (torch.stack([(each / noise).flatten() for each in moved], 1) for moved in (slopes, starts))
    A = A - N @ torch.linalg.lstsq(N, A).solution
    return A.T @ A, A.T @ ((seen - c) / noise).flatten()
