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
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.trainers import Sizes, online_trainer
from recipes import common
from recipes.common import Run, hidden_truth
from recipes.fetch import STEPS, demonstrate, fetch, figures, friction_estimator, learning_in, objective


@dataclass(frozen=True)
class Settings(common.Settings):
    """One run."""

    noise: float = 0.0
    """the observations are exact"""
    low: float = 0.1
    """least friction of the prior"""
    high: float = 2.0
    """greatest friction of the prior"""
    demonstrations: float = 0.2
    """share of a minibatch from demonstrations; 0 for none"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.05 <= self.low < self.high <= 2 or not 0 <= self.demonstrations < 1:
            problem = f"low {self.low}, high {self.high}, demonstrations {self.demonstrations}"
            raise BadInput(problem, "needs .05 <= low < high <= 2 and 0 <= demonstrations < 1")


def build(settings: Settings) -> Run:
    """The whole composition: worlds, prior, objective, estimator, real system, trainer."""
    return build_task("push", settings, demonstrated=4 if settings.short else 10)


def build_task(name: str, settings: Settings, demonstrated: int) -> Run:
    """A task whose object has an unknown friction.

    Args:
        name: ``"push"`` or ``"slide"``.
        settings: of the run.
        demonstrated: batches of 64 episodes that are shown.
    """
    space = ParameterSpace({FRICTION: Parameter(settings.low, settings.high)})
    made = fetch(name, space)
    learner = objective(made, demonstrations=settings.demonstrations)
    if settings.demonstrations:
        demonstrate(made, learner, made.lean.prior, demonstrated, settings.seed + 5000)
    truth = hidden_truth(space, settings.seed, {FRICTION: min(settings.high, 1.0)})
    first, steps, batches, simulations, epochs = (4, 2, 2, 100, 4) if settings.short else (80, 6, 12, 1000, 40)
    schedule = settings.schedule(steps, batches, real_steps=STEPS)
    trainer = online_trainer(
        made.exact,
        learner,
        estimator=partial(friction_estimator, epochs),
        real=made.exact.hidden(truth, settings.seed + 2000),
        schedule=replace(schedule, first_batches=first) if schedule.order == "online" else schedule,
        sizes=Sizes(simulations=simulations, groups=32),
        worlds=settings.worlds(made.exact, truth),
        seed=settings.seed,
    )
    trainer = learning_in(trainer, made, settings.seed)
    return Run(made.exact, trainer, truth, figures=lambda: figures(made, learner.policy, truth))


if __name__ == "__main__":
    sys.exit(common.main("fetch_push", build, __doc__, Settings))
