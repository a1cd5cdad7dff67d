"""``make combination``: what the calibrated product of single posteriors is worth, beside the plain one and the union.

| belief from n = 4 trajectories    | how                                                              |
|-----------------------------------|------------------------------------------------------------------|
| union                             | sum_i q(theta | x_i) / n                                         |
| product                           | prod_i q(theta | x_i)                                            |
| calibrated product                | the same with scales times w, w found on held-out groups         |

All three read one fitted network; they are judged on 256 groups that it has not seen, simulated under a random policy
over the whole prior. A seed decides the network, its simulations and the groups.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass

from onlinebayes.experiments import Run, Settings, status
from onlinebayes.inference import NeuralEstimator
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.runs import Progress, ResultTable, generator, seed_everything
from recipes import acrobot, cartpole, pendulum

BUILD: dict[str, Callable[[Settings], Run]] = {
    "pendulum": pendulum.build,
    "cartpole": cartpole.build,
    "acrobot": acrobot.build,
}
TRAJECTORIES, GROUPS, LEVEL = 4, 256, 0.95
WAYS = ("union", "product", "calibrated product")


@dataclass(frozen=True)
class Study:
    """All seeds."""

    tasks: tuple[str, ...] = tuple(BUILD)
    """which recipes"""
    seeds: tuple[int, ...] = (101, 102, 103, 104, 105)
    """that nothing was tuned on"""


def main(study: Study) -> int:
    """Fit, judge, print the table."""
    table = ResultTable("combination", "make combination", study.seeds)
    with Progress("combination", len(study.tasks) * len(study.seeds)) as progress:
        for t, task in enumerate(study.tasks):
            found = []
            for s, seed in enumerate(study.seeds):
                progress.update(t * len(study.seeds) + s, f"{task}, seed {seed}")
                found.append(judged(BUILD[task](Settings(seed=seed)), seed))
            for way in WAYS:
                table.add_seeds(f"{task}, {way}: log density of the truth", [f[way][0] for f in found], unit="nats")
                table.add_seeds(f"{task}, {way}: share in the {LEVEL:g} region", [f[way][1] for f in found])
    print(table.to_markdown())
    print(f"written: {table.write()}")
    return 0


def judged(made: Run, seed: int) -> dict[str, tuple[float, float]]:
    """Mean log density of the truth and share of truths in the region, for each way of one fitted network."""
    seed_everything(seed)
    draws, trainer, prior = generator(seed, "combination"), made.trainer, made.problem.prior
    policies = [trainer.objective.policy] * TRAJECTORIES
    estimator = trainer.estimator(prior)
    assert isinstance(estimator, NeuralEstimator)
    estimator.fit(
        trainer.simulations.draw(policies[:1], prior), trainer.held_out.groups(policies, prior), generator=draws
    )
    groups = made.problem.simulations(GROUPS, trainer.schedule.real_steps, seed + 5000).groups(policies, prior)
    theta = groups["theta"][:, 0, 0]
    found = {}
    for way, factor in zip(WAYS, (math.inf, 1.0, estimator.combination), strict=True):
        estimator.combination = factor
        posterior = estimator.each(groups)
        inside = credibility_of(posterior, theta, generator=draws) <= LEVEL
        found[way] = (float(posterior.log_prob(theta).mean()), float(inside.double().mean()))
    return found


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
