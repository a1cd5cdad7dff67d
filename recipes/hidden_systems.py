"""The two machines that ``hidden_effect`` learns on, beside the model of each: pendulum and cart with a pole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from envs.cartpole import CartPole, CartPoleTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import Objective, PPOSettings, ppo, sac
from onlinebayes.parameters import Parameter
from onlinebayes.simulators import Task, TorchSimulator
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction, Effect
from onlinebayes.simulators.stepping import Integrator
from onlinebayes.trainers import Excited, HeldActions, Limits, Problem, RealSystem, range_of
from recipes import cartpole, pendulum
from recipes.hidden_machine import CARTPOLE, PENDULUM, Equations, Hidden


class FinePendulum(Pendulum):
    """The model, integrated finely enough to be held against a machine."""

    timestep = 0.0125
    defaults = {**Pendulum.defaults, "length": 0.5, "mass": 0.5}  # noqa: RUF012


class FineCartPole(CartPole):
    """The model, integrated finely enough to be held against a machine."""

    timestep = 0.01
    integrator: ClassVar[Integrator] = "semi-implicit"
    defaults = {**CartPole.defaults, "length": 0.5, "mass": 0.5}  # noqa: RUF012


@dataclass(frozen=True)
class System:
    """One of the two machines and its model.

    Args:
        model: of the machine, at its control period.
        task: of the policy.
        equations: of the machine.
        recipe: whose parameters, sensors and states are meant.
        objective: specs -> policy and learning.
        joint: that rubs.
        truths: bounds of what is hidden behind the seeds, where the task can be done at all with the effect.
        friction, delay: sizes that hurt [N, N m; s].
        batches, batch_steps, real_steps: of an outer step.
        first_batches: of the first one; 0 where an untrained policy moves the machine well.
        excitation: how the machine is moved on purpose; None where its policy moves it well.
    """

    model: TorchSimulator
    task: Task
    equations: Equations
    recipe: Any
    objective: Callable[..., Objective]
    joint: str
    truths: dict[str, tuple[float, float]]
    friction: float
    delay: float
    batches: int
    batch_steps: int
    real_steps: int
    first_batches: int
    excitation: Callable[[RealSystem], Excited] | None = None


def pushed(cart: RealSystem) -> Excited:
    """At most twice 2 s of full force one way or the other, half a second each, within a metre of the middle.

    The pole ends such a trajectory when it leans by 12 degrees, as it does with any policy.
    """
    limit = torch.tensor([1.0, torch.inf, torch.inf, torch.inf])

    def back(observation: Tensor) -> Tensor:
        left = observation[..., :1] > 0
        return torch.cat([left, ~left], -1).long()

    excitation = HeldActions(CartPoleTask().action_spec, 25, Limits(-limit, limit, back))
    return Excited(cart, excitation, range_of(0), least=LEAST_WAY, steps=round(2.0 / CartPole.timestep), most=2)


LEAST_WAY = 0.3
"""Of the cart [m]: below it the policy hardly moves."""

SYSTEMS = {
    "pendulum": System(
        FinePendulum(pendulum.SPACE, dt=Pendulum.timestep),
        PendulumTask(),
        PENDULUM,
        pendulum,
        partial(sac, settings=pendulum.LEARNING),
        "hinge",
        {"length": (0.5, 0.9), "mass": (0.4, 0.8)},
        friction=0.8,
        delay=0.15,
        batches=36,
        batch_steps=16,
        real_steps=50,
        first_batches=0,
    ),
    "cartpole": System(
        FineCartPole(cartpole.SPACE, dt=CartPole.timestep),
        CartPoleTask(),
        CARTPOLE,
        cartpole,
        partial(ppo, settings=PPOSettings(epochs=10)),
        "cart",
        {"length": (0.4, 0.7), "mass": (0.2, 0.5)},
        friction=9.0,
        delay=0.08,
        batches=16,
        batch_steps=64,
        real_steps=60,
        first_batches=20,
        excitation=pushed,
    ),
}


def hides(system: System, what: str) -> tuple[Hidden, Effect | None]:
    """Return the effect that a machine hides, and the library's word for it."""
    if what == "friction":
        joint = system.model.targets("joint").index(system.joint)
        effect = DryFriction(system.joint, Parameter(0.0, 5 * system.friction, ""))
        return Hidden(friction=system.friction, joint=joint), effect
    if what == "delay":
        return Hidden(delay=system.delay), ActuatorDelay("motor", Parameter(0.0, 0.2, "s"))
    return Hidden(), None


def known(
    problem: Problem, truth: Float[Tensor, " P"], effect: Effect | None, hidden: Hidden
) -> tuple[Problem, Float[Tensor, " Q"]]:
    """The problem of somebody who knows what is hidden, and all its true values."""
    if effect is None:
        return problem, truth
    simulator = problem.simulator.with_effect(effect)
    whole = torch.cat([truth, truth.new_tensor([hidden.friction or hidden.delay])])
    return Problem(simulator, problem.task, BoxUniform(simulator.parameters), problem.sensor_sd), whole
