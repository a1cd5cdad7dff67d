"""A planner that learns what it plans with: swing-ups of unknown machines after one episode's data.

    python -m recipes.swing_up [--system pendulum] [--seed S] [--short]      a minute or two

The planner (MPPI over the belief, see ``docs/concepts/planning.md``) first plans for the prior, all of it. What its
first episode showed, behind noisy sensors, makes a posterior by the exact likelihood; with it the planner swings up
from starts that it has not seen. Beside it: the same planner, told the truth, from the same starts. On MuJoCo, where
that likelihood takes minutes, a belief stands in its place that is off by as much as it says itself.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import torch
from jaxtyping import Float
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torch import Tensor

from envs.cartpole import CartPole
from envs.pendulum import MAX_SPEED, Pendulum, PendulumTask
from envs.swing_up import SwingUpTask, cart_pole, state_of
from onlinebayes.control import MPPI, Bounds, Knots, TaskCost
from onlinebayes.experiments import Options, closing_line, hidden_truth, place_of, status
from onlinebayes.inference import Belief, BoxUniform, TruncatedMixture
from onlinebayes.inference.filtered import filter_of
from onlinebayes.inference.likelihood import LikelihoodEstimator
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import generator, seed_everything
from onlinebayes.simulators import Simulator, Task
from onlinebayes.trainers import Journal, Point, Problem, SimulatedPlayer
from onlinebayes.trainers.trajectories import returns, trajectories
from onlinebayes.transforms import ParameterRandomization
from recipes import pendulum

Name = Literal["cartpole", "pendulum", "mujoco"]
NEAR = 1.05  # times the cost that the truth gets


@dataclass(frozen=True)
class Settings(Options):
    """One machine."""

    system: Name = "cartpole"
    """cart-pole by equations, pendulum, or a cart-pole on MuJoCo"""
    noise: float = 0.005
    """standard deviation of the sensor noise, as a share of each observed value's range"""
    steps: int = 50
    """played under the prior and measured"""
    starts: int = 4
    """from which the planner is judged"""


@dataclass(frozen=True)
class System:
    """A machine and the settings of its planner."""

    space: ParameterSpace
    simulator: Callable[[ParameterSpace], Simulator]
    task: Task
    state: Callable[[Tensor], TensorDict]
    range: Float[Tensor, " O"]
    default: dict[str, float]
    horizon: int
    samples: int
    sd: float
    temperature: float
    learns: bool = True


LENGTH_MASS = {"length": Parameter(0.5, 1.0, "m"), "mass": Parameter(0.5, 1.0, "kg")}
POLE = {"length": Parameter(0.25, 1.0, "m"), "mass": Parameter(0.05, 0.5, "kg")}
MOTOR = {"body.pole.mass": Parameter(0.05, 0.5, "kg"), "actuator.motor.gear": Parameter(6.0, 16.0, "N")}
CART_RANGE = torch.tensor((2.0, 6.0, 2.0, 2.0, 20.0))  # of position, speed, cosine, sine, rate
SYSTEMS: dict[Name, System] = {
    "cartpole": System(
        ParameterSpace(POLE), lambda space: CartPole(space, dt=0.04), SwingUpTask(), state_of, CART_RANGE,
        {"length": 0.6, "mass": 0.2}, horizon=30, samples=128, sd=0.7, temperature=0.3,
    ),
    "pendulum": System(
        ParameterSpace(LENGTH_MASS), Pendulum, PendulumTask(horizon=100), pendulum.state,
        torch.tensor((2.0, 2.0, 2 * MAX_SPEED)), {"length": 0.9, "mass": 0.9},
        horizon=30, samples=128, sd=1.5, temperature=1.0,
    ),
    "mujoco": System(
        ParameterSpace(MOTOR), cart_pole, SwingUpTask(), state_of, CART_RANGE,
        {"body.pole.mass": 0.2, "actuator.motor.gear": 10.0}, horizon=30, samples=64, sd=0.7,
        temperature=0.3, learns=False,
    ),
}  # fmt: skip


def planner_of(system: System, seed: int, short: bool = False) -> MPPI:
    """The planner, without a belief so far."""
    task = system.task
    return MPPI(
        system.simulator(system.space),
        TaskCost(task),
        state=system.state,
        bounds=Bounds.of(task.action_spec),
        noise=Knots(system.sd, 5),
        horizon=system.horizon,
        samples=system.samples // (2 if short else 1),
        thetas=4,
        temperature=system.temperature,
        command=task.command,
        seed=seed,
    )


def problem_of(system: System, planner: MPPI, noise: float) -> Problem:
    """The machine behind its sensors."""
    simulator, prior = system.simulator(system.space), BoxUniform(system.space)
    return Problem(simulator, system.task, prior, noise * system.range, planner.transforms)


def cost_of(problem: Problem, planner: MPPI, truth: Float[Tensor, " P"], starts: int, seed: int) -> Float[Tensor, " N"]:
    """Of an episode from each of some starts, by perfect sensors: noise in them spreads costs by more than 5 %."""
    planner.reset()
    env = replace(problem, sensor_sd=None).worlds(starts, ParameterRandomization(Point(truth)), seed)
    return -returns(env, planner, problem.task.horizon)


def belief_of(
    problem: Problem, system: System, planner: MPPI, truth: Float[Tensor, " P"], steps: int, seed: int
) -> Belief:
    """Infer the belief from the first steps under the prior, or make up one that it could be."""
    if not system.learns:
        return plausible(problem, truth, seed)
    planner.set_belief(problem.prior)
    measured = trajectories(problem.worlds(1, ParameterRandomization(Point(truth)), seed), planner, steps)
    model = filter_of(problem.simulator, problem.task, problem.prior.box, state=system.state)
    estimator = LikelihoodEstimator(model, problem.prior.box, problem.task.action_spec.shape[-1])
    simulations = problem.simulations(100, 30, seed)  # tell how noisy the sensors are, and where episodes begin
    pushes = TensorDictModule(lambda o: problem.task.action_spec.rand(o.shape[:-1]), ["observation"], ["action"])
    simulated = simulations.draw([pushes], problem.prior)
    estimator.fit(simulated, generator=generator(seed, "likelihood"))
    return estimator.condition(measured.exclude("theta"))


def plausible(problem: Problem, truth: Float[Tensor, " P"], seed: int) -> Belief:
    """A Gaussian of 1 % of the prior's width in each parameter, about a centre that is off by a draw of itself.

    The truth gains about 6 nats over the prior. From 50 steps the exact likelihood gains 6 to 9 on the pendulum and 8
    to 10 on the cart-pole by equations (``make planner``).
    """
    box, sd = problem.prior.box, 0.01 * torch.eye(len(truth), dtype=torch.float64)
    off = sd @ torch.randn(len(truth), generator=generator(seed, "plausible"), dtype=torch.float64)
    return TruncatedMixture(torch.zeros(1, dtype=torch.float64), (box.to_frame(truth) + off)[None], sd[None], box)


def main(settings: Settings) -> int:
    """Plan for the prior, learn, plan again; 0 where the cost is near that of the truth."""
    if settings.short:
        settings = replace(settings, starts=1, steps=30)
    seed_everything(settings.seed)
    system = SYSTEMS[settings.system]
    truth = hidden_truth(system.space, settings.seed, system.default)
    planner = planner_of(system, settings.seed, settings.short)
    problem = problem_of(system, planner, settings.noise)
    place, player = place_of(f"swing_up-{settings.system}", settings), SimulatedPlayer(problem, planner, truth)
    with Journal(place, f"swing_up-{settings.system}", problem.prior, player, truth) as journal:
        cost = partial(cost_of, problem, planner, truth, settings.starts, settings.seed + 2)
        planner.set_belief(problem.prior)
        blind = float(cost().mean())
        journal.step("prior", figures={"return": -blind})

        posterior = belief_of(problem, system, planner, truth, settings.steps, settings.seed + 1)
        planner.set_belief(posterior)
        learnt = float(cost().mean())
        gain = float(posterior.log_prob(truth) - problem.prior.log_prob(truth))
        journal.step("posterior", belief=posterior, figures={"return": -learnt, "gain": gain})

        planner.set_belief(Point(truth))
        best = float(cost().mean())
    print(f"cost of an episode: {blind:.1f} for the prior, {learnt:.1f} for the posterior, {best:.1f} for the truth")
    print(f"the truth gains {gain:.1f} nats over the prior")
    print(closing_line(place))
    return 0 if learnt <= NEAR * best and gain > 0 else 1


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
