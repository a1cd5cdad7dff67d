"""A machine that hides an effect from its model, which learns of it on the way: measure, criticise, grow, learn on.

    python -m recipes.hidden_effect [--system cartpole] [--effect delay] [--kind blind] [--seed S]     a few minutes

A pendulum (or a cart with a pole) has a dry friction or a late actuator. The policy learns in worlds of a model that
has neither, and the belief makes up for it with a wrong mass. After some real trajectories criticism names the effect,
the simulator gets it, the belief its parameter, and the policy learns on in worlds that have it; ``run.rrd`` shows it.

The machine is no simulator of the library: see ``hidden_machine``, and ``hidden_systems`` for the two. ``--kind blind``
is the same run without criticism, ``--kind oracle`` a policy in worlds of the truth, ``--effect nothing`` a machine
that hides nothing.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.experiments import STOPPED, Options, closing_line, hidden_truth, place_of, status
from onlinebayes.inference import BoxUniform, filtered_estimator, fit
from onlinebayes.objectives import Objective, settings_of
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput, RunFolder, seed_everything, write_atomic
from onlinebayes.trainers import (
    Episode,
    GrowingTrainer,
    LoggedRuns,
    OnlineState,
    OnlineTrainer,
    Point,
    PolicyFiles,
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
from recipes.hidden_machine import Machine
from recipes.hidden_systems import SYSTEMS, hides, known

TRAJECTORIES = 5  # real ones in each outer step
MOMENTS = (1, 2)  # complete outer steps after which criticism is asked: of 5 and of 10 trajectories


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
    excite: bool = False
    """move the machine on purpose for 2 s, within limits, where its policy hardly does; of the cart-pole only"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.noise < 1 or self.steps < 1:
            raise BadInput(f"noise {self.noise}, steps {self.steps}", "needs 0 <= noise < 1 and a step or more")
        if self.excite and SYSTEMS[self.system].excitation is None:
            raise BadInput(f"a {self.system} is excited enough by its policy", "leave out --excite")


@dataclass(frozen=True)
class Parts:
    """Parts of a run.

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
    truth = hidden_truth(bounds, settings.seed + 1, {})  # seed 0 is a recipe's own values: here are none
    sd, prior = settings.noise * system.recipe.RANGE, BoxUniform(space)
    hidden, effect = hides(system, settings.effect)
    machine = Problem(Machine(system.equations, space, hidden, system.model.dt), system.task, prior, sd)
    real: RealSystem = RealEnvironment(
        machine.worlds(TRAJECTORIES, ParameterRandomization(Point(truth)), settings.seed + 2000)
    )
    if settings.excite and system.excitation is not None:
        real = system.excitation(real)
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


def main(settings: Settings) -> int:
    """One run in a folder of its own; returns the exit status."""
    seed_everything(settings.seed)
    place = folder_of(settings)
    told = {key: value for key, value in asdict(settings).items() if key != "out"}
    parts = build(settings)
    with RunFolder(place, "hidden_effect", settings=told, objective=settings_of(parts.objective)) as folder:
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
            files = PolicyFiles(place, "hidden_effect", parts.objective, parts.begun)
            watchers = (recording, files)
            state = run_in_folder(parts.trainer, parts.begun.prior, folder, judge=parts.judge, watchers=watchers)
        if state.interrupted:
            print(f"stopped; kept: {state.kept()}. The same command goes on from there")
            return STOPPED
        write_atomic(folder.path("finished"), "")
    last, hidden = state.records[-1], {name.rpartition(".")[0] for name in parts.further}
    print(f"hidden: {', '.join(hidden) or 'nothing'}; found: {', '.join(last.grown) or 'nothing'}")
    print(f"return on the machine: {last.figures['return']:.1f}")
    print(closing_line(place))
    return 0 if settings.kind != "criticised" or set(last.grown) == hidden else 1


def folder_of(settings: Settings) -> Path:
    """A run's folder."""
    return place_of("-".join(["hidden_effect", settings.system, settings.effect, settings.kind]), settings)


if __name__ == "__main__":
    sys.exit(status(main, Settings, __doc__))
