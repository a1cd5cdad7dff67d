"""A filter through the simulator gives what least squares over the whole trajectory gives, where all is linear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from onlinebayes.embeddings import FilteredEmbedding, Rows
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


def exact(seen: Tensor, action: Tensor) -> tuple[float, float]:
    """Least squares over (q0, v0, z) of one trajectory (T + 1, 2): z, and its variance."""
    zero, one = torch.zeros(1, 2).double(), torch.eye(2).double()
    c = clean(SPACE.low[None], zero, action[None])[0]
    columns = [clean(SPACE.low[None], one[k : k + 1], action[None])[0] - c for k in range(2)]
    columns.append(clean(SPACE.high[None], zero, action[None])[0] - c)
    A = torch.stack([(column / NOISE).flatten() for column in columns], dim=1)
    y = ((seen - c) / NOISE).flatten()
    return float(torch.linalg.lstsq(A, y[:, None]).solution[2]), float(torch.linalg.inv(A.T @ A)[2, 2])


def test_on_a_linear_system_it_is_exact() -> None:
    theta = torch.linspace(0.8, 2.2, 8, dtype=torch.float64)[:, None]
    observation, action, following = measured(theta, seed=0)
    made = embedding()
    made.model.noise.copy_(NOISE)
    features, mask = made.features(observation, action, following), torch.ones(8, STEPS, dtype=torch.bool)
    alone = made.encode(features, mask)[:, -2:]
    pairs = made.encode_set(features.unflatten(0, (4, 2)), mask.unflatten(0, (4, 2)))[:, -2:]
    seen = torch.cat([observation[:, :1], following], dim=1)
    truths = [exact(seen[b], action[b]) for b in range(8)]
    for b, (z, variance) in enumerate(truths):
        assert float(alone[b, 0]) == pytest.approx(z, abs=1e-4)
        # The flat belief, half a box wide, counts as one row more.
        assert float(alone[b, 1]) ** -2 == pytest.approx(1 / variance + 4, rel=1e-4)
    # Two trajectories of a set say together what their weighted mean says.
    for g, ((z, variance), (other, its)) in enumerate(zip(truths[::2], truths[1::2], strict=True)):
        assert float(pairs[g, 0]) == pytest.approx((z / variance + other / its) / (1 / variance + 1 / its), abs=1e-4)
        assert float(pairs[g, 1]) ** -2 == pytest.approx(1 / variance + 1 / its + 4, rel=1e-4)


def test_the_likelihood_is_that_of_the_whole_trajectory() -> None:
    observation, action, following = measured(torch.tensor([[1.5]]).double(), seed=4)
    made = embedding()
    made.model.noise.copy_(NOISE)
    many = 5
    rows = made.rows(made.features(observation, action, following), torch.ones(1, STEPS, dtype=torch.bool))
    grid = torch.linspace(0.3, 0.7, many, dtype=torch.float64)[:, None]
    found = made.model.log_likelihood(Rows(*(part.expand(many, *part.shape[1:]) for part in rows)), grid)
    z, variance = exact(torch.cat([observation[:, :1], following], dim=1)[0], action[0])
    parabola = -0.5 * (grid[:, 0] - z).square() / variance
    torch.testing.assert_close(found - found[0], parabola - parabola[0], rtol=1e-4, atol=1e-4)


def test_a_set_does_not_depend_on_its_order_or_its_padding() -> None:
    theta = torch.full((3, 1), 1.2, dtype=torch.float64)
    made = embedding()
    made.model.noise.copy_(NOISE)
    rows = made.features(*measured(theta, seed=5))[None]
    mask = torch.ones(1, 3, STEPS, dtype=torch.bool)
    together = made.encode_set(rows, mask)
    order = torch.tensor([2, 0, 1])
    torch.testing.assert_close(made.encode_set(rows[:, order], mask[:, order]), together, rtol=1e-6, atol=1e-6)
    empty = torch.cat([rows, torch.full_like(rows[:, :1], 0.3)], dim=1)
    none = torch.cat([mask, torch.zeros_like(mask[:, :1])], dim=1)
    torch.testing.assert_close(made.encode_set(empty, none), together, rtol=1e-6, atol=1e-6)


def test_the_noise_is_read_off_the_simulations() -> None:
    draw = torch.Generator().manual_seed(1)
    theta = SPACE.from_unit(torch.rand(200, 1, dtype=torch.float64, generator=draw))
    made = embedding()
    made.fit(*measured(theta, seed=2), torch.ones(200, STEPS, dtype=torch.bool))
    # The median of a hundred means of twenty squares: a few per cent, and the median of a skew distribution lies below.
    torch.testing.assert_close(made.model.noise, NOISE, rtol=0.15, atol=0)


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
    told = short[-1, :-2]
    assert bool((told == 0).all())
