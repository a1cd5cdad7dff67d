"""Hidden effects and null sets: does refine name what is missing, and nothing where nothing is.

A rig with its own integrator (envs/driven_pendulum) hides dry friction, quadratic drag, a spring or a delay, 10 each,
and nothing in 60 sets; an engineer's MJCF is fitted to what its encoder read. Two processes share the sets.

    python -m recipes.studies.blind                 all 100 sets -> docs/results/blind.json
    python -m recipes.studies.blind --hidden 1 --null 2 --out /tmp/blind
"""

from __future__ import annotations

import multiprocessing
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from onlinebayes.criticism import Criticism, refine
from onlinebayes.identification import make_windows, replay_error, replay_runs, split
from onlinebayes.runs import Progress, ResultTable
from onlinebayes.simulators.mujoco import MujocoSimulator
from recipes.command import status
from recipes.studies.blind_data import FREE, KINDS, MODEL, BlindCase, cases

SIGNAL = "qpos.hinge"
HIDDEN = tuple(kind for kind in KINDS if kind != "null")


@dataclass(frozen=True)
class Study:
    """What to run.

    Args:
        hidden: sets of each of the four hidden effects.
        null: sets without one.
        workers: processes.
        out: folder of the result.
    """

    hidden: int = 10
    null: int = 60
    workers: int = 2
    out: Path = Path("docs/results")


@dataclass(frozen=True)
class Outcome:
    """One set judged.

    Args:
        kind, seed: which set.
        verdict, first, accepted: what refine said, the candidate it ranked first, and what it added.
        named: whether the hidden effect was ranked first and accepted (null set: whether nothing was).
        before, after: held-out error over its noise floor.
        at_truth: the same for the final model at the rig's own parameters. No method can be expected to go below it:
            a held-out run has ten windows, and how well their starts were smoothed decides it.
        seconds: wall time.
    """

    kind: str
    seed: int
    verdict: str
    first: str
    accepted: str
    named: bool
    before: float
    after: float
    at_truth: float
    seconds: float

    @property
    def improved(self) -> bool:
        """Whether the held-out error fell by half or reached 1.2 times the floor."""
        return self.after <= 0.5 * self.before or self.after <= 1.2

    @property
    def ideal(self) -> bool:
        """Whether the held-out error is within 2 % of what the rig's own parameters give."""
        return self.after <= 1.02 * self.at_truth


def judge(kind: str, seed: int) -> Outcome:
    """Make one set and refine it, as a user would with the engineer's model."""
    (case,) = cases((kind,), range(seed, seed + 1))
    began = time.monotonic()
    result = refine(MujocoSimulator(MODEL, FREE, threads=1), case.measurement, holdout=case.holdout)
    return outcome(case, result, time.monotonic() - began)


def outcome(case: BlindCase, result: Criticism, seconds: float) -> Outcome:
    """Compare what refine found with the truth."""
    first = next((c.effect for c in result.candidates if c.rank == 1), "")
    named = first == case.hidden and case.hidden in result.accepted if case.hidden else not result.accepted
    floor = result.heldout_error.noise_floor[SIGNAL]
    return Outcome(
        case.kind,
        case.seed,
        result.verdict,
        first,
        ", ".join(result.accepted),
        named,
        result.heldout_error.before[SIGNAL] / floor,
        result.heldout_error.after[SIGNAL] / floor,
        error_at_truth(case, result) / floor,
        seconds,
    )


def error_at_truth(case: BlindCase, result: Criticism) -> float:
    """Held-out error of the final model with the rig's own parameters in place of the fitted ones [rad]."""
    model, (_, held) = result.final, split(case.measurement, case.holdout)
    fitted = dict(zip(model.simulator.parameters, model.theta, strict=True))
    theta = torch.stack([torch.as_tensor(case.truth.get(name, value)).to(value) for name, value in fitted.items()])
    horizon = result.selection.horizon_s
    noise = torch.tensor([result.sensor_sd[SIGNAL]], dtype=torch.float64)
    windows = make_windows(model.simulator, held, horizon, 0.1 * horizon, noise, inset=True)
    return replay_error(replay_runs(model.simulator, windows, theta, held_out=True), (SIGNAL,))[SIGNAL]


def run(study: Study) -> list[Outcome]:
    """All sets, in the order of kind and seed."""
    sets = [(kind, seed) for kind in HIDDEN for seed in range(study.hidden)]
    sets += [("null", seed) for seed in range(study.null)]
    found: list[Outcome] = []
    context = multiprocessing.get_context("spawn")
    with (
        Progress("blind", len(sets)) as progress,
        ProcessPoolExecutor(study.workers, context, initializer=torch.set_num_threads, initargs=(1,)) as pool,
    ):
        waiting = [pool.submit(judge, kind, seed) for kind, seed in sets]
        for done in as_completed(waiting):
            found.append(done.result())
            progress.update(len(found), f"{found[-1].kind} {found[-1].seed}: {found[-1].accepted or 'nothing'}")
    order = {kind: k for k, kind in enumerate(KINDS)}
    return sorted(found, key=lambda o: (order[o.kind], o.seed))


def table(found: list[Outcome], study: Study) -> ResultTable:
    """The counts with their goals, then every set."""
    results = ResultTable("blind", "make blind", range(max(study.hidden, study.null)))
    hidden, null = [o for o in found if o.kind != "null"], [o for o in found if o.kind == "null"]
    named, false = sum(o.named for o in hidden), sum(not o.named for o in null)
    most = len(hidden) - round(len(hidden) / 20)
    results.add("hidden effect ranked first and accepted", named, unit=f"of {len(hidden)}", goal=f"at least {most}",
                holds=named >= most)  # fmt: skip
    improved = sum(o.improved for o in hidden if o.named)
    ideal = sum(o.improved or o.ideal for o in hidden if o.named)
    results.add("of these, held-out error halved or within 1.2 floors", improved, unit=f"of {named}", goal="all",
                holds=improved == named)  # fmt: skip
    results.add("the same, or within 2 % of what the true parameters give", ideal, unit=f"of {named}", goal="all",
                holds=ideal == named)  # fmt: skip
    results.add("null sets with something accepted", false, unit=f"of {len(null)}", goal="at most 1", holds=false <= 1)
    ratios = [o.before for o in hidden]
    if ratios:
        results.add("base error over the floor, least", min(ratios), unit="floors", goal="at least 2",
                    holds=min(ratios) >= 2)  # fmt: skip
        results.add("base error over the floor, greatest", max(ratios), unit="floors", goal="at most 10",
                    holds=max(ratios) <= 10)  # fmt: skip
    results.add("time a set, mean", sum(o.seconds for o in found) / max(len(found), 1), unit="s")
    for o in found:
        errors = f"{o.before:.2f} -> {o.after:.2f} ({o.at_truth:.2f})"
        unit = "effects accepted; held-out error in floors (at the true parameters)"
        results.add(f"{o.kind} {o.seed}", o.accepted or "nothing", spread=errors, unit=unit, goal=o.verdict)
    return results


def main(study: Study) -> None:
    """Run the study, write its table and print the counts."""
    found = run(study)
    results = table(found, study)
    path = results.write(study.out)
    for row in results.rows[: len(results.rows) - len(found)]:
        held = {None: "", True: "holds", False: "MISSED"}[row.holds]
        print(f"{row.name}: {row.value} {row.unit} ({row.goal or 'no goal'}) {held}")
    for o in found:
        if not o.named or (o.kind != "null" and not o.improved):
            print("  ", asdict(o))
    print(f"written: {path}")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
