"""A pendulum takes up a load in mid-run: the belief notices, says so in the log, and follows; the policy goes on.

    python -m recipes.changing_machine [--seed S] [--short]     one run, some minutes; Ctrl-C and again goes on

The hidden pendulum is light for the first trajectories and heavy from then on. A belief that takes all trajectories
for those of one machine ends sure and wrong. A ``Hazard`` says that a machine may change, and the notes of the log
say when it did: "the machine changed after trajectory 3 (probability 0.999)". The policy goes on in worlds of the heavy
one.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from tensordict import TensorDict

from envs.pendulum import Pendulum, PendulumTask
from onlinebayes.embeddings.likeliest import DISTURBED, STRAIGHT
from onlinebayes.experiments import Run, Settings, place_of, run, status
from onlinebayes.inference import BoxUniform, Hazard, filtered_estimator, fit
from onlinebayes.objectives import SACSettings, sac
from onlinebayes.runs import BadInput
from onlinebayes.trainers import Policy, Problem, RealEnvironment, Sizes, online_trainer
from recipes.pendulum import RANGE, SPACE, state

NAME = "changing_machine"
LENGTH, LIGHT, HEAVY = 0.6, 0.3, 0.75


@dataclass(frozen=True)
class ChangingSettings(Settings):
    """One run."""

    before: int = 3
    """trajectories of the light pendulum"""
    after: int = 3
    """trajectories of the heavy one"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.before < 1 or self.after < 1:
            raise BadInput(f"{self.before} trajectories before and {self.after} after", "needs one of each at least")


class TakesUpALoad:
    """A real system that is one environment for some trajectories, and another one after that.

    Args:
        light: before.
        heavy: after.
        before: number of trajectories of the first.
    """

    def __init__(self, light: RealEnvironment, heavy: RealEnvironment, before: int) -> None:
        self._light, self._heavy, self._before, self._made = light, heavy, before, 0

    def run(self, policy: Policy, steps: int) -> TensorDict:
        """The next trajectory."""
        self._made += 1
        return (self._light if self._made <= self._before else self._heavy).run(policy, steps)

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the system, for a checkpoint."""
        return {"made": self._made, "light": self._light.state_dict(), "heavy": self._heavy.state_dict()}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Stand there again."""
        self._made = state["made"]
        self._light.load_state_dict(state["light"])
        self._heavy.load_state_dict(state["heavy"])


def build(settings: ChangingSettings) -> Run:
    """The composition of ``recipes.pendulum``, with a machine that changes and a hazard."""
    problem = Problem(Pendulum(SPACE), PendulumTask(), BoxUniform(SPACE), settings.noise * RANGE)
    light, heavy = (SPACE.vector({"length": LENGTH, "mass": mass}) for mass in (LIGHT, HEAVY))
    real = TakesUpALoad(
        problem.hidden(light, settings.seed + 2000), problem.hidden(heavy, settings.seed + 2001), settings.before
    )
    learning = SACSettings(tau=0.02, gamma=0.98, reward_scale=0.1, alpha=0.3, frames_per_update=8, memory=20_000)
    objective = sac(*problem.specs, settings.learning(learning))
    batches, simulations, groups, epochs = (1, 300, 24, 25) if settings.short else (10, 300, 64, 25)
    real_steps = 25 if settings.short else 50  # the filter's time grows with it
    schedule = settings.schedule(settings.before + settings.after, batches, real_steps=real_steps)
    schedule = replace(schedule, behaviours=1, group=2) if settings.short else schedule
    trainer = online_trainer(
        problem,
        objective,
        estimator=filtered_estimator(
            problem.simulator,
            problem.task,
            state=state,
            train=partial(fit, epochs=epochs, batch_size=50, learning_rate=1e-3),
            levels=STRAIGHT if settings.short else DISTURBED,
        ),
        real=real,
        schedule=schedule,
        sizes=Sizes(worlds=64, batch_steps=16, simulations=simulations, groups=groups),
        worlds=settings.worlds(problem, heavy),
        hazard=Hazard(),
        seed=settings.seed,
    )
    return Run(problem, trainer, heavy)


def main(settings: ChangingSettings) -> int:
    """0 where the belief holds the heavy pendulum, and the log says after which trajectory it became that."""
    code = run(NAME, build, settings)
    if code or settings.kind != "online" or settings.seeds:
        return code
    log = (place_of(NAME, settings) / "log.csv").read_text(encoding="utf-8")
    said = f"the machine changed after trajectory {settings.before} " in log
    print(f"the log {'says' if said else 'does not say'} that the machine changed after trajectory {settings.before}")
    return 0 if said else 1


if __name__ == "__main__":
    sys.exit(status(main, ChangingSettings, __doc__))
