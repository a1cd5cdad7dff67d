"""``make demo-seeds``: the demonstration on five rigs -> docs/results/demo-seeds.json.

Each seed has its own rig, noise, networks and episodes. The claim: on each of them the missing effect is named, the
mended model's posterior holds the rig's parameters, and the policy trained in the mended model's worlds beats the other
one by two standard errors of the difference over the episodes.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from envs.driven_pendulum.rig import DELAY
from onlinebayes.experiments import status
from onlinebayes.runs import ResultTable, atomic_path
from recipes.demo.picture import picture
from recipes.demo.run import SIGNAL, Budget, Outcome, run
from recipes.studies.jobs import finished

SEEDS = (0, 1, 2, 3, 4)
HIDDEN = "actuator_delay@motor"
STANDARD_ERRORS = 2.0
FARTHEST = 4.0  # sd


def tabulate(outcomes: Sequence[Outcome]) -> ResultTable:
    """One block of rows a seed."""
    table = ResultTable("demo-seeds", "make demo-seeds", [outcome.seed for outcome in outcomes])
    for outcome in outcomes:
        error, (difference, se) = outcome.criticism.heldout_error, outcome.advantage
        named = outcome.criticism.accepted
        seed = f"seed {outcome.seed}"
        table.add(f"{seed}: hidden delay", 1e3 * outcome.truth[DELAY], unit="ms")
        table.add(f"{seed}: effects named", ", ".join(named) or "none", goal=HIDDEN, holds=named == (HIDDEN,))
        table.add(f"{seed}: held-out error before", 1e3 * error.before[SIGNAL], unit="mrad")
        table.add(
            f"{seed}: held-out error after",
            1e3 * error.after[SIGNAL],
            unit="mrad",
            goal="half of before, or 1.2 times the floor",
            holds=error.after[SIGNAL] <= max(0.5 * error.before[SIGNAL], 1.2 * error.noise_floor[SIGNAL]),
        )
        table.add(
            f"{seed}: the rig's parameters from the mended posterior's mean",
            outcome.farthest,
            unit="sd, the farthest of them",
            goal=f"<= {FARTHEST:g}",
            holds=outcome.farthest <= FARTHEST,
        )
        for name, branch in (("model as it was", outcome.wrong), ("mended model", outcome.mended)):
            spread = float(branch.returns.std())
            table.add(f"{seed}: return, {name}", float(branch.returns.mean()), spread=spread, unit="of 100 steps")
        table.add(
            f"{seed}: difference of the returns",
            difference,
            spread=se,
            unit="steps",
            goal=f"at least {STANDARD_ERRORS:g} standard errors (spread)",
            holds=difference >= STANDARD_ERRORS * se,
        )
        table.add(f"{seed}: time", outcome.seconds, unit="s")
    return table


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    seeds: tuple[int, ...] = SEEDS
    """of rigs, noise and networks"""
    out: Path = Path("out/demo-seeds")
    """folder of the demonstrations"""
    results: Path = Path("docs/results")
    """folder of the table"""


def main(study: Study) -> int:
    """Run the seeds one after the other and write the table."""
    outcomes = []
    for seed in study.seeds:
        outcomes.append(run(seed, study.out / str(seed), Budget()))
        with atomic_path(study.out / str(seed) / "demo.png") as path:
            picture(outcomes[-1]).savefig(path, dpi=150)
    return finished(tabulate(outcomes), study.results)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
