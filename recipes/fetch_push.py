"""The Fetch arm pushes a block of unknown friction: hindsight, demonstrations, and a posterior over the friction.

    python -m recipes.fetch_push [--demonstrations 0] [--kind prior]      ten minutes; Ctrl-C and again goes on

The schedule is the thesis's: the policy first learns in worlds of the prior, then in turns with the posterior, and its
memory is short, so that what it learnt in worlds that are no longer believed in fades. A fifth of its minibatches are
demonstrations of a scripted pusher. Needs the extra robotics.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from functools import partial

from envs.fetch import FRICTION
from onlinebayes import experiments
from onlinebayes.experiments import Run, hidden_truth
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.trainers import Sizes, online_trainer
from recipes.fetch import (
    LEARNING,
    STEPS,
    WORLDS,
    demonstrate,
    fetch,
    figures,
    friction_estimator,
    objective,
    refuse_noise,
)

MEMORY = 200_000  # steps: by the end of a run the worlds of the prior are forgotten


@dataclass(frozen=True)
class Settings(experiments.Settings):
    """One run."""

    noise: float = 0.0
    """0: the observations are exact"""
    low: float = 0.1
    """least friction of the prior"""
    high: float = 2.0
    """greatest friction of the prior"""
    demonstrations: float = 0.2
    """share of a minibatch from demonstrations; 0 for none"""

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_noise(self.noise)
        if not 0.05 <= self.low < self.high <= 2 or not 0 <= self.demonstrations < 1:
            problem = f"low {self.low}, high {self.high}, demonstrations {self.demonstrations}"
            raise BadInput(problem, "needs .05 <= low < high <= 2 and 0 <= demonstrations < 1")


@dataclass(frozen=True)
class Amounts:
    """Budget of all parts.

    Attributes:
        first: batches in worlds of the prior, before anything is measured.
        steps: outer steps.
        batches: of each of the others.
        simulations: of a fit, of each policy.
        epochs: of a fit.
        shown: batches of demonstrations.
        groups: held-out thetas by which the belief is judged.
        judged: episodes by which the policy is judged.
        frames_per_update: fresh frames for which one gradient step is taken.
    """

    first: int
    steps: int
    batches: int
    simulations: int
    epochs: int
    shown: int = 5
    groups: int = 32
    judged: int = 128
    frames_per_update: int = 16


SHORT = Amounts(first=4, steps=2, batches=2, simulations=48, epochs=4, shown=2, groups=16, judged=32)
LONG = Amounts(first=80, steps=6, batches=12, simulations=1000, epochs=40)


def build(settings: Settings) -> Run:
    """The whole composition: worlds, prior, objective, estimator, real system, trainer."""
    return build_task("push", settings, SHORT if settings.short else LONG)


def build_task(name: str, settings: Settings, much: Amounts) -> Run:
    """A task whose object has an unknown friction.

    Args:
        name: ``"push"`` or ``"slide"``.
        settings: of the run.
        much: how much of everything.
    """
    space = ParameterSpace({FRICTION: Parameter(settings.low, settings.high)})
    made = fetch(name, space)
    learning = replace(
        LEARNING,
        frames_per_update=much.frames_per_update,
        demonstrations=settings.demonstrations,
        memory=MEMORY,
    )
    learner = objective(made, settings.learning(learning))
    if settings.demonstrations:
        demonstrate(made, learner, made.lean.prior, much.shown, settings.seed + 5000)
    own = float(made.exact.simulator.nominal.clamp(settings.low, settings.high))
    truth = hidden_truth(space, settings.seed, {FRICTION: own}, settings.truth)
    schedule = replace(settings.schedule(much.steps, much.batches, real_steps=STEPS), first_batches=much.first)
    trainer = online_trainer(
        made.exact,
        learner,
        estimator=partial(friction_estimator, much.epochs),
        real=made.exact.hidden(truth, settings.seed + 2000),
        schedule=schedule,
        sizes=Sizes(worlds=WORLDS, batch_steps=STEPS, simulations=much.simulations, groups=much.groups),
        worlds=settings.worlds(made.exact, truth),
        learn_in=made.lean,
        seed=settings.seed,
    )
    return Run(made.exact, trainer, truth, figures=lambda: figures(made, learner.policy, truth, much.judged))


if __name__ == "__main__":
    sys.exit(experiments.main("fetch_push", build, __doc__, Settings))
