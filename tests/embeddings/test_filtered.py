"""A filter over state and parameters gives what least squares over the whole trajectory gives, where all is linear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, TorchSimulator

SPACE = ParameterSpace({"gain": Parameter(0.5, 2.5, "1/kg")})
NOISE = torch.tensor([0.02, 0.05], dtype=torch.float64)
STEPS = 20


class Slide(TorchSimulator):
    """A mass that a force of known size pushes: linear in state and gain."""

    physical = SPACE
    defaults = {"gain": 1.0}  # noqa: RUF012
    joints = (Joint("rail", "slide"),)
    actuators = (Actuator("motor", "rail"),)
    timestep = 0.1

    def acceleration(self, parameters: Mapping[str, Tensor], q: Tensor, v: Tensor, tau: Tensor) -> Tensor:
        return parameters["gain"] * tau


@dataclass(frozen=True)
class Whole:
    """The bounds as a box."""

    def from_frame(self, z: Tensor) -> Tensor:
        return SPACE.from_unit(z.clamp(0, 1))


def state(observation: Tensor) -> TensorDict:
    q, v = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": q, "qvel": v}, batch_size=observation.shape[:1])


def observe(state: TensorDictBase) -> Tensor:
    return torch.cat([state["qpos"], state["qvel"]], dim=-1)


def embedding() -> FilteredEmbedding:
    return FilteredEmbedding(Slide(SPACE), Whole(), 2, 1, state=state, command=lambda a: a, observe=observe).double()


def measured(theta: Tensor, seed: int, noise: Tensor = NOISE) -> tuple[Tensor, Tensor, Tensor]:
    """Noisy observation, action, next observation (B, T, .)."""
    draw = torch.Generator().manual_seed(seed)
    B = len(theta)
    action = torch.randn(B, STEPS, 1, dtype=torch.float64, generator=draw)
    begin = torch.randn(B, 2, dtype=torch.float64, generator=draw)
    path = clean(theta, begin, action)
    path = path + noise * torch.randn(path.shape, dtype=torch.float64, generator=draw)
    return path[:, :-1].clone(), action, path[:, 1:].clone()


def clean(theta: Tensor, begin: Tensor, action: Tensor) -> Tensor:
    """Observations (B, T + 1, 2) without noise."""
    times = 0.1 * torch.arange(1, STEPS + 1, dtype=torch.float64)
    inputs = TensorDict({"command": action}, batch_size=action.shape[:2])
    path = Slide(SPACE).rollout(theta, state(begin), inputs, times)
    return torch.cat([begin[:, None], observe(path)], dim=1)


def test_on_a_linear_system_it_is_exact() -> None:
    theta = torch.linspace(0.8, 2.2, 8, dtype=torch.float64)[:, None]
    observation, action, following = measured(theta, seed=0)
    made = embedding()
    made.noise.copy_(NOISE)
    rows = made.features(observation, action, following)
    z, covariance, _ = made._filtered(rows, torch.ones(8, STEPS, dtype=torch.bool))
    seen = torch.cat([observation[:, :1], following], dim=1)
    for b in range(8):
        # y = A (q0, v0, z) + c, rows in units of noise.
        zero, one = torch.zeros(1, 2).double(), torch.eye(2).double()
        c = clean(SPACE.low[None], zero, action[b : b + 1])[0]
        columns = [clean(SPACE.low[None], one[k : k + 1], action[b : b + 1])[0] - c for k in range(2)]
        columns.append(clean(SPACE.high[None], zero, action[b : b + 1])[0] - c)
        A = torch.stack([(column / NOISE).flatten() for column in columns], dim=1)
        y = ((seen[b] - c) / NOISE).flatten()
        assert float(z[b]) == pytest.approx(float(torch.linalg.lstsq(A, y[:, None]).solution[2]), abs=1e-5)
        # The flat belief, half a box wide, counts as one row more.
        exact = torch.linalg.inv(A.T @ A + torch.diag(torch.tensor([0.0, 0.0, 4.0]).double()))
        assert float(covariance[b]) == pytest.approx(float(exact[2, 2]), rel=1e-4)


def test_the_noise_is_read_off_the_simulations() -> None:
    draw = torch.Generator().manual_seed(1)
    theta = SPACE.from_unit(torch.rand(200, 1, dtype=torch.float64, generator=draw))
    made = embedding()
    made.fit(*measured(theta, seed=2), torch.ones(200, STEPS, dtype=torch.bool))
    # The median of 200 means of twenty squares: a few per cent, and the median of a skew distribution lies below.
    torch.testing.assert_close(made.noise, NOISE, rtol=0.15, atol=0)


def test_padding_is_not_read() -> None:
    theta = torch.linspace(0.8, 2.2, 6, dtype=torch.float64)[:, None]
    observation, action, following = measured(theta, seed=3)
    mask = torch.arange(STEPS) < torch.tensor([20, 12, 7, 3, 1, 0])[:, None]
    made = embedding()
    made.fit(observation, action, following, mask)
    short = made(observation, action, following, mask)
    for rows in (observation, action, following):
        rows[~mask] = float("nan")
    assert torch.equal(made(observation, action, following, mask), short)
    alone = made(observation[2:3, :7], action[2:3, :7], following[2:3, :7])
    torch.testing.assert_close(alone, short[2:3])
    assert bool((short[-1] == 0).all())
