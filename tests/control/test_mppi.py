"""The planner as a policy: what it promises of batches, beginnings, beliefs, checkpoints and bad input."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import TransformedEnv

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.control import MPPI, Bounds, Knots, TaskCost
from onlinebayes.control.testing import check_planner
from onlinebayes.inference import BoxUniform
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import SimulatorEnv
from onlinebayes.simulators.effects.actuator_delay import ActuatorDelay
from onlinebayes.trainers.simulations import Point

SPACE = ParameterSpace({"length": Parameter(0.5, 1.5, "m"), "mass": Parameter(0.5, 1.5, "kg")})
TASK, PRIOR = PendulumTask(), BoxUniform(SPACE)


def state(observation: Tensor) -> TensorDict:
    cos, sin, rate = observation.double().split(1, dim=-1)
    return TensorDict({"qpos": torch.atan2(sin, cos), "qvel": rate}, batch_size=observation.shape[:1])


def planner(belief: Any = PRIOR, **changes: Any) -> MPPI:
    settings = {
        "state": state,
        "bounds": Bounds.of(TASK.action_spec),
        "noise": Knots(1.5),
        "horizon": 12,
        "samples": 16,
        "thetas": 3,
        "command": TASK.command,
    }
    parts = {"simulator": Pendulum(SPACE), "cost": TaskCost(TASK)}
    given = {**parts, **settings, **changes}
    return MPPI(given.pop("simulator"), given.pop("cost"), belief, **given)


def observations(number: int, seed: int = 0) -> TensorDict:
    draw = torch.randn(number, 2, generator=torch.Generator().manual_seed(seed))
    seen = torch.stack((draw[:, 0].cos(), draw[:, 0].sin(), draw[:, 1]), dim=-1)
    return TensorDict({"observation": seen}, batch_size=(number,))


def test_conformance() -> None:
    def env() -> SimulatorEnv:
        return SimulatorEnv(Pendulum(SPACE, worlds=2), PendulumTask(horizon=4), seed=1)

    point = Point(SPACE.vector({"length": 1.5, "mass": 1.5}))
    check_planner(lambda: planner(None, control_cost=0.1), env, PRIOR, point)


def test_a_copy_shares_the_simulator() -> None:
    first = planner()
    assert copy.deepcopy(first).search.simulator is first.search.simulator


def test_worlds_come_from_the_belief_and_change_with_it() -> None:
    one = planner()
    one(observations(1))
    assert one.report is not None
    first = one.report.theta
    assert len(first.unique(dim=0)) == 3
    one(observations(1))
    assert not torch.equal(first, one.report.theta)
    point = SPACE.vector({"length": 0.7, "mass": 0.6})
    one.set_belief(Point(point))
    one(observations(1))
    assert torch.allclose(one.report.theta, point.expand(3, -1))


def test_rates_hold_between_steps_too() -> None:
    one, last = planner(bounds=Bounds((-2.0,), (2.0,), rate=4.0)), torch.zeros(2, 1)
    for k in range(5):
        action = one(observations(2, seed=k))["action"]
        assert float((action - last).abs().max()) <= 4.0 * 0.05 + 1e-6
        last = action


@pytest.mark.slow
def test_it_swings_a_known_pendulum_up() -> None:
    truth = SPACE.vector({"length": 1.0, "mass": 1.0})
    env = TransformedEnv(SimulatorEnv(Pendulum(SPACE, worlds=2), TASK, seed=1))
    policy = planner(Point(truth), horizon=25, samples=64, thetas=1)
    for transform in policy.transforms():
        env.append_transform(transform)
    states = env.rollout(90, policy)["next", "observation"]
    assert bool((states[:, -10:, 0] > 0.98).all())


def some_nan(theta: float) -> Callable[..., Tensor]:
    """A cost that is no number in the first of three worlds where the pendulum is fast."""

    def cost(before: TensorDictBase, action: Tensor, after: TensorDictBase) -> Tensor:
        wrong = torch.arange(len(action)) % 48 < 16
        values = after["qpos"][..., 0].square()
        return values.masked_fill(wrong[:, None], theta)

    return cost


def test_rollouts_without_a_cost_are_left_out_and_said() -> None:
    one = planner(cost=some_nan(torch.nan))
    action = one(observations(2))["action"]
    assert bool(action.isfinite().all())
    assert one.report is not None
    assert one.report.without.tolist() == [[16, 0, 0], [16, 0, 0]]


def test_bad_input_is_one_clear_line() -> None:
    with pytest.raises(BadInput, match="no belief yet"):
        planner(None)(observations(1))
    with pytest.raises(BadInput, match="not finite"):
        planner()(TensorDict({"observation": torch.full((1, 3), torch.nan)}, batch_size=(1,)))
    with pytest.raises(BadInput, match="no candidate has a cost"):
        planner(cost=lambda before, action, after: action[..., 0] * torch.nan)(observations(1))
    with pytest.raises(BadInput, match="a cost of shape"):
        planner(cost=lambda before, action, after: action)(observations(1))
    with pytest.raises(BadInput, match="draws of the belief have 1"):
        planner(BoxUniform(SPACE.subspace(["mass"])))
    with pytest.raises(BadInput, match="plan has shape"):
        planner(horizon=9).load_state_dict(planner().state_dict())


def test_a_horizon_shorter_than_a_dead_time_is_refused() -> None:
    late = Pendulum(SPACE).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.6, "s")))
    belief = BoxUniform(late.parameters)
    with pytest.raises(BadInput, match=r"actuator_delay@motor of up to 0\.59.* with a horizon of 0\.5 s"):
        planner(belief, simulator=late, horizon=10)
    planner(belief, simulator=late, horizon=13)(observations(1))


def test_commands_on_their_way_are_known_to_the_next_plan() -> None:
    """A late pendulum plans as one that is told its complete state, with what its delay remembers."""
    late = Pendulum(SPACE, worlds=2).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.2, "s")))
    truth = Point(late.parameters.vector({"length": 1.0, "mass": 1.0, "actuator_delay@motor.delay": 0.12}))
    env = SimulatorEnv(late, TASK, seed=1, with_state=True)
    env.reset(TensorDict({"theta": truth.sample((2,))}, batch_size=(2,)))
    changes = {"simulator": late, "thetas": 1, "noise": Knots(1.0)}
    remembers = planner(truth, **changes)
    told = planner(
        truth, observation_key="state", **{**changes, "state": lambda s: s.select("qpos", "qvel", "effects")}
    )
    seen = env.reset(TensorDict({"theta": truth.sample((2,))}, batch_size=(2,)))
    for _ in range(6):
        seen["observation"] = seen["observation"].double()
        seen = remembers(seen)
        assert torch.allclose(seen["action"], told(seen.clone())["action"], atol=1e-4)
        seen = env.step(seen)["next"]
