"""A machine that hides an effect from its model, which learns of it on the way: measure, criticise, grow, learn on.

    python -m recipes.hidden_effect [--system cartpole] [--effect delay] [--kind blind] [--seed S]     a few minutes

A pendulum (or a cart with a pole) has a dry friction or a late actuator. The policy learns in worlds of a model that
has neither, and the belief makes up for it with a wrong mass. After some real trajectories criticism names the effect,
the simulator gets it, the belief its parameter, and the policy learns on in worlds that have it; ``run.rrd`` shows it.

The machine is no simulator of the library: see ``hidden_machine``. ``--kind blind`` is the same run without criticism,
``--kind oracle`` a policy in worlds of the truth, ``--effect nothing`` a machine that hides nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Literal

import torch
from jaxtyping import Float
from torch import Tensor

from envs.cartpole import CartPole, CartPoleTask
from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.inference import BoxUniform, filtered_estimator, fit
from onlinebayes.objectives import Objective, ppo, sac
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, RunFolder, seed_everything, write_atomic
from onlinebayes.simulators import Task, TorchSimulator
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction, Effect
from onlinebayes.simulators.stepping import Integrator
from onlinebayes.trainers import (
    Episode,
    GrowingTrainer,
    LoggedRuns,
    OnlineState,
    OnlineTrainer,
    Point,
    Problem,
    RealEnvironment,
    RealSystem,
    Recording,
    Schedule,
    SearchCritic,
    SimulatedPlayer,
    Sizes,
    online_trainer,
    run_in_folder,
)
from onlinebayes.transforms import ParameterRandomization
from recipes import cartpole, pendulum
from recipes.command import STOPPED, status
from recipes.common import Options, hidden_truth, place_of, written
from recipes.hidden_machine import CARTPOLE, PENDULUM, Equations, Hidden, Machine

TRAJECTORIES = 5  # real ones in each outer step
MOMENTS = (1, 2)  # complete outer steps after which criticism is asked: of 5 and of 10 trajectories


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


def soft(*specs: Any) -> Objective:
    """SAC as in the pendulum's recipe."""
    return sac(*specs, tau=0.02, gamma=0.98, reward_scale=0.1, alpha=0.3, frames_per_update=8, memory=20_000)


SYSTEMS = {
    "pendulum": System(
        FinePendulum(pendulum.SPACE, dt=Pendulum.timestep),
        PendulumTask(),
        PENDULUM,
        pendulum,
        soft,
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
        partial(ppo, epochs=10),
        "cart",
        {"length": (0.4, 0.7), "mass": (0.2, 0.5)},
        friction=9.0,
        delay=0.08,
        batches=16,
        batch_steps=64,
        real_steps=60,
        first_batches=20,
    ),
}


@dataclass(frozen=True)
class Settings(Options):
    """One run."""

    system: Literal["pendulum", "cartpole"] = "pendulum"
    """which machine"""
    effect: Literal["friction", "delay", "nothing"] = "friction"
    """what it hides"""
    kind: Literal["criticised", "blind", "oracle"] = "criticised"
    """with criticism; without; a policy in worlds of the truth"""
    noise: float = 0.01
    """standard deviation of the sensor noise, as a share of each observed value's range"""
    steps: int = 5
    """outer steps"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.noise < 1 or self.steps < 1:
            raise BadInput(f"noise {self.noise}, steps {self.steps}", "needs 0 <= noise < 1 and a step or more")


@dataclass(frozen=True)
class Parts:
    """What a run is made of.

    Args:
        trainer: of this kind of run.
        objective: the policy and its learning.
        begun: the problem at the beginning.
        machine: the real system with the task, for judging.
        truth: what of it the model has parameters for at the beginning.
        further: the rest, by the names that the library gives it.
    """

    trainer: OnlineTrainer | GrowingTrainer
    objective: Objective
    begun: Problem
    machine: Problem
    truth: Float[Tensor, " P"]
    further: dict[str, float]

    @property
    def problem(self) -> Problem:
        """As it is now."""
        return self.trainer.problem if isinstance(self.trainer, GrowingTrainer) else self.begun

    def judge(self, state: OnlineState) -> dict[str, float]:
        """The policy's return on the machine, and the log density of what is true there."""
        names = state.belief.space.names[len(self.truth) :]
        truth = torch.cat([self.truth, self.truth.new_tensor([self.further.get(name, float("nan")) for name in names])])
        known = {} if truth.isnan().any() else {"log density of the truth": float(state.belief.log_prob(truth))}
        return {"return": self.machine.score(self.objective.policy, self.truth, episodes=32), **known}

    def played(self, state: OnlineState) -> dict[str, Episode]:
        """An episode of the machine, and the same commands in the model."""
        return SimulatedPlayer(self.problem, self.objective.policy, self.truth, self.machine)(state)


def build(settings: Settings) -> Parts:
    """The whole composition."""
    system, space = SYSTEMS[settings.system], SYSTEMS[settings.system].recipe.SPACE
    bounds = ParameterSpace({name: Parameter(*system.truths[name]) for name in space})
    truth = hidden_truth(bounds, settings.seed + 1, {})  # point 0 of a Sobol sequence is a corner
    sd, prior = settings.noise * system.recipe.RANGE, BoxUniform(space)
    hidden, effect = hides(system, settings.effect)
    machine = Problem(Machine(system.equations, space, hidden, system.model.dt), system.task, prior, sd)
    real = RealEnvironment(machine.worlds(TRAJECTORIES, ParameterRandomization(Point(truth)), settings.seed + 2000))
    problem = Problem(system.model, system.task, prior, sd)
    objective = system.objective(*problem.specs)
    if settings.kind == "oracle":
        knowing, whole = known(problem, truth, effect, hidden)
        trainer: OnlineTrainer | GrowingTrainer = trainer_over(knowing, settings, objective, real, Point(whole))
    elif settings.kind == "blind":
        trainer = trainer_over(problem, settings, objective, real)
    else:
        make = partial(trainer_over, settings=settings, objective=objective, real=real)
        trainer = GrowingTrainer(problem, make, SearchCritic(LoggedRuns(system.recipe.state)), MOMENTS)
    further = {} if effect is None else {f"{effect.key}.{effect.magnitude}": hidden.friction or hidden.delay}
    return Parts(trainer, objective, problem, machine, truth, further)


def trainer_over(
    problem: Problem,
    settings: Settings,
    objective: Objective,
    real: RealSystem,
    worlds: Point | None = None,
) -> OnlineTrainer:
    """The online trainer over a problem, whatever effects its simulator has by then."""
    system = SYSTEMS[settings.system]
    batches, simulations, epochs = (2, 60, 4) if settings.short else (system.batches, 150, 15)
    train = partial(fit, epochs=epochs, batch_size=50, learning_rate=1e-3)
    if worlds is None:
        first = min(batches, system.first_batches)
        schedule = Schedule(settings.steps, batches, system.real_steps, behaviours=2, group=3, first_batches=first)
    else:
        schedule = Schedule(settings.steps, batches, system.real_steps, "policy-only")
    return online_trainer(
        problem,
        objective,
        estimator=filtered_estimator(problem.simulator, problem.task, state=system.recipe.state, train=train),
        real=real,
        schedule=schedule,  # type: ignore[arg-type]
        sizes=Sizes(worlds=64, batch_steps=system.batch_steps, simulations=simulations, groups=40),
        worlds=worlds,
        seed=settings.seed,
    )


def hides(system: System, what: str) -> tuple[Hidden, Effect | None]:
    """What a machine hides, and the library's word for it."""
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


def main(settings: Settings) -> int:
    """One run in a folder of its own; returns the exit status."""
    seed_everything(settings.seed)
    place = folder_of(settings)
    told = {key: value for key, value in asdict(settings).items() if key != "out"}
    with RunFolder(place, "hidden_effect", settings=told) as folder:
        parts = build(settings)
        recording = Recording(
            place,
            "hidden_effect",
            parts.begun.prior,
            parts.played,
            parts.truth,
            infers=settings.kind != "oracle",
            further=parts.further,
        )
        with recording:
            state = run_in_folder(parts.trainer, parts.begun.prior, folder, judge=parts.judge, watchers=(recording,))
        if state.interrupted:
            print(f"stopped; kept: {state.kept()}. The same command goes on from there")
            return STOPPED
        write_atomic(folder.path("finished"), "")
    last, hidden = state.records[-1], {name.rpartition(".")[0] for name in parts.further}
    print(f"hidden: {', '.join(hidden) or 'nothing'}; found: {', '.join(last.grown) or 'nothing'}")
    print(f"return on the machine: {last.figures['return']:.1f}")
    print(written(place))
    return 0 if settings.kind != "criticised" or set(last.grown) == hidden else 1


def folder_of(settings: Settings) -> Path:
    """A run's folder."""
    return place_of("-".join(["hidden_effect", settings.system, settings.effect, settings.kind]), settings)


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
