"""The Fetch arm hits a puck to goals that it cannot reach: how far a puck slides depends on its friction.

    python -m recipes.fetch_slide [--kind prior]      half an hour or more; Ctrl-C and again goes on

Nothing is shown to the policy. The schedule is that of ``fetch_push``, with a longer first part. Needs the extra
robotics.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

from onlinebayes import experiments
from onlinebayes.experiments import Run
from recipes import fetch_push
from recipes.fetch_push import SHORT, Amounts, build_task


@dataclass(frozen=True)
class Settings(fetch_push.Settings):
    """One run."""

    high: float = 1.0
    """greatest friction of the prior"""
    demonstrations: float = 0.0
    """share of a minibatch from demonstrations: nobody shows how to hit"""


LONG = Amounts(first=200, steps=6, batches=16, simulations=2000, epochs=60, frames_per_update=8)


def build(settings: Settings) -> Run:
    """The whole composition: worlds, prior, objective, estimator, real system, trainer."""
    return build_task("slide", settings, SHORT if settings.short else LONG)


if __name__ == "__main__":
    sys.exit(experiments.main("fetch_slide", build, __doc__, Settings))
