"""The posterior by a filter's likelihood is the exact one on a linear system, and keeps the estimators' promises."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Unbounded

from onlinebayes.inference import Box, BoxUniform, LikelihoodEstimator
from onlinebayes.inference.testing import check_estimator
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Actuator, Joint, Task, TorchSimulator

SPACE = ParameterSpace({"gain": Parameter(0.5, 2.5, "1/kg"), "offset": Parameter(-1.0, 1.0, "m/s2")})
PRIOR = BoxUniform(SPACE)
NOISE = torch.tensor([0.05, 0.1], dtype=torch.float64)
STEPS = 20


class Slide(TorchSimulator):
    """A mass that a force of known size pushes: linear in state and parameters."""

    physical = SPACE
    defaults = {"gain": 1.0, "offset": 0.0}  # noqa: RUF012
    joints = (Joint("rail", "slide"),)
    actuators = (Actuator("motor", "rail"),)
    timestep = 0.1

    def acceleration(self, parameters: Mapping[str, Tensor], q: Tensor, v: Tensor, tau: Tensor) -> Tensor:
        return parameters["gain"] * tau + parameters["offset"]


class Seen(Task):
    """Position and velocity are observed."""

    observation_size, horizon = 2, STEPS
    action_spec = Unbounded((1,))

    def start(self, theta: Tensor, generator: torch.Generator) -> TensorDict:
        raise NotImplementedError

    def observe(self, state: TensorDictBase) -> Tensor:
        return torch.cat([state["qpos"], state["qvel"]], dim=-1)

    def command(self, action: Tensor) -> Tensor:
        return action

    def reward(self, state: TensorDictBase, action: Tensor, after: TensorDictBase) -> Tensor:
        raise NotImplementedError

    def terminated(self, state: TensorDictBase) -> Tensor:
        raise NotImplementedError


def state(observation: Tensor) -> TensorDict:
    q, v = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": q, "qvel": v}, batch_size=observation.shape[:1])


def path(theta: Tensor, begin: Tensor, action: Tensor) -> Tensor:
    """Observations (B, T + 1, 2) without noise."""
    times = 0.1 * torch.arange(1, STEPS + 1, dtype=torch.float64)
    inputs = TensorDict({"command": action.double()}, batch_size=action.shape[:2])
    made = Slide(SPACE).rollout(theta, state(begin), inputs, times)
    return torch.cat([begin[:, None], Seen().observe(made)], dim=1)


def simulate(theta: Tensor, generator: torch.Generator) -> TensorDict:
    """Starts anywhere, random forces, noisy sensors."""
    B = len(theta)
    action = torch.randn(B, STEPS, 1, generator=generator)
    begin = torch.randn(B, 2, dtype=torch.float64, generator=generator)
    seen = path(theta, begin, action)
    seen = seen + NOISE * torch.randn(seen.shape, dtype=torch.float64, generator=generator)
    after = TensorDict({"observation": seen[:, 1:]}, batch_size=action.shape[:2])
    values = {"observation": seen[:, :-1], "action": action, "theta": theta[:, None].expand(-1, STEPS, -1)}
    return TensorDict({**values, "next": after}, batch_size=action.shape[:2])


def estimator(draws: int = 500) -> LikelihoodEstimator:
    return LikelihoodEstimator(Slide(SPACE), Seen(), Box.whole(SPACE), state=state, draws=draws)


def exact(trajectories: TensorDict) -> tuple[Tensor, Tensor]:
    """Mean and covariance of z for sets (n, T), by least squares over all starts and z at once; no bounds."""
    information, pull = torch.zeros(2, 2).double(), torch.zeros(2).double()
    for one in trajectories:
        action = one["action"][None]
        seen = torch.cat([one["observation"][:1], one["next", "observation"]]).double()
        low, start = SPACE.low[None].double(), torch.zeros(1, 2).double()
        c = path(low, start, action)[0]
        moves = [path(low, row[None], action)[0] - c for row in torch.eye(2).double()]
        moves += [path(low + row * (SPACE.high - SPACE.low), start, action)[0] - c for row in torch.eye(2).double()]
        A = torch.stack([(move / NOISE).flatten() for move in moves], dim=1)
        y = ((seen - c) / NOISE).flatten()
        nuisance = A[:, :2]
        clear = torch.eye(len(y)).double() - nuisance @ torch.linalg.pinv(nuisance)
        information += A[:, 2:].T @ clear @ A[:, 2:]
        pull += A[:, 2:].T @ clear @ y
    return torch.linalg.solve(information, pull), torch.linalg.inv(information)


def test_on_a_linear_system_it_is_exact() -> None:
    draw = torch.Generator().manual_seed(0)
    theta = SPACE.from_unit(torch.full((6, 2), 0.5).double())
    groups = torch.stack([simulate(theta, draw) for _ in range(4)], dim=1)
    made = estimator()
    made.embedding.model.noise.copy_(NOISE)
    batch = made.each(groups)
    assert bool((batch.effective > 500).all())
    for g in range(6):
        mean, covariance = exact(groups[g])
        gaussian = torch.distributions.MultivariateNormal(mean, covariance)
        points = (mean + 1.5 * torch.randn(5, 2, generator=draw).double() @ torch.linalg.cholesky(covariance).T).clamp(
            0, 1
        )
        found = batch[g].log_prob(SPACE.from_unit(points)) + math.log(4.0)
        # 1500 weighted draws: the evidence is right to 3 %; the box cuts off next to nothing.
        torch.testing.assert_close(found, gaussian.log_prob(points), rtol=0, atol=0.1)
        drawn = SPACE.to_unit(batch[g].sample((2000,), draw))
        sd = covariance.diagonal().sqrt()
        assert bool(((drawn.mean(0) - mean).abs() < 0.15 * sd).all())
        assert bool(((drawn.std(0) / sd - 1).abs() < 0.1).all())


def test_its_credibilities_are_those_of_its_density() -> None:
    draw = torch.Generator().manual_seed(1)
    theta = PRIOR.sample((8,), draw)
    made = estimator()
    made.embedding.model.noise.copy_(NOISE)
    posterior = made.each(simulate(theta, draw)[:, None])
    drawn = posterior.sample((300,), draw)
    by_hand = (posterior.log_prob(drawn) >= posterior.log_prob(theta)).double().mean(0)
    torch.testing.assert_close(posterior.credibility(theta), by_hand, rtol=0, atol=0.12)  # 4 sd of 300 draws


@pytest.mark.slow
def test_it_keeps_the_protocol() -> None:
    check_estimator(lambda: estimator(200), simulate, PRIOR, simulations=300)
