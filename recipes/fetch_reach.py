"""The Fetch arm brings its gripper to points in the air: DDPG with hindsight learns it within some thousand steps.

    python -m recipes.fetch_reach [--seed S]       half a minute; Ctrl-C and again goes on

Nothing is unknown here: nothing is touched. Needs the extra robotics.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from typing import Literal

from onlinebayes import experiments
from onlinebayes.experiments import Run
from onlinebayes.parameters import ParameterSpace
from onlinebayes.trainers import Sizes, online_trainer
from recipes.fetch import LEARNING, STEPS, fetch, figures, objective, refuse_noise


@dataclass(frozen=True)
class Settings(experiments.Settings):
    """One run."""

    noise: float = 0.0
    """0: the observations are exact"""
    kind: Literal["oracle"] = "oracle"
    """there is nothing to infer"""

    def __post_init__(self) -> None:
        super().__post_init__()
        refuse_noise(self.noise)


def build(settings: Settings) -> Run:
    """The whole composition: worlds, objective, trainer."""
    made = fetch("reach", ParameterSpace({}))
    learner = objective(made, settings.learning(replace(LEARNING, frames_per_update=8)))
    truth = made.exact.simulator.nominal
    trainer = online_trainer(
        made.exact,
        learner,
        schedule=settings.schedule(2 if settings.short else 4, 2, real_steps=STEPS),
        sizes=Sizes(worlds=25, batch_steps=STEPS),
        worlds=settings.worlds(made.exact, truth),
        learn_in=made.lean,
        seed=settings.seed,
    )
    before = made.exact.score(learner.policy, truth)
    return Run(made.exact, trainer, truth, to_beat=before, figures=lambda: figures(made, learner.policy, truth))


if __name__ == "__main__":
    sys.exit(experiments.main("fetch_reach", build, __doc__, Settings))
