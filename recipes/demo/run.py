"""The whole loop on one rig: measure, find the missing effect, infer, train, and run both policies on the rig."""

from __future__ import annotations

import json
import logging
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from envs.driven_pendulum import Protocol
from onlinebayes.cli.summary import summary
from onlinebayes.criticism import Criticism, ModelMixture, Question, worlds_of
from onlinebayes.inference import BoxUniform
from onlinebayes.problems import criticise, load_problem
from onlinebayes.report import write_report
from onlinebayes.runs import write_atomic
from onlinebayes.trainers import Journal, PolicyFiles
from recipes.demo.measure import known, measure, write_problem
from recipes.demo.policy import Training, episodes, learner, player, returns, score, train

SIGNAL = "qpos.hinge"
WRONG, MENDED = "the model as it was", "the mended model"
FOLDERS = {WRONG: "as_it_was", MENDED: "."}


@dataclass(frozen=True)
class Budget:
    """Budget of all parts; the two models get the same.

    Args:
        protocol: what is recorded on the rig.
        training: of the policy.
        episodes: that each policy runs on the rig.
        processes: 2 to train for both models at once, 1 for one after the other in this process.
    """

    protocol: Protocol = field(default_factory=lambda: Protocol(fit=8, held=2, seconds=4.0))
    training: Training = field(default_factory=Training)
    episodes: int = 20
    processes: int = 2


QUICK = Budget(
    Protocol(fit=7, held=2, seconds=2.0),
    Training(worlds=64, steps=16, batches=3),
    episodes=4,
    processes=1,
)
"""Shows in a few seconds that the pieces connect; its policies have learnt nothing."""


@dataclass(frozen=True)
class Branch:
    """Results of one model.

    Args:
        names: its parameters.
        samples: draws from its posterior [SI].
        angle: of the episodes on the rig, from upright [rad].
        returns: of these episodes.
    """

    names: tuple[str, ...]
    samples: Float[Tensor, "S P"]
    angle: Float[Tensor, "N T"]
    returns: Float[Tensor, " N"]


@dataclass(frozen=True)
class Outcome:
    """Results for the table and the picture."""

    seed: int
    truth: Mapping[str, float]
    criticism: Criticism
    wrong: Branch
    mended: Branch
    seconds: float

    @property
    def advantage(self) -> tuple[float, float]:
        """Mean difference of the returns, mended less wrong, and its standard error over the episodes."""
        a, b = self.mended.returns, self.wrong.returns
        return float(a.mean() - b.mean()), float((a.var() / len(a) + b.var() / len(b)).sqrt())

    @property
    def farthest(self) -> float:
        """The largest distance of the rig's parameters from the mended model's posterior [its standard deviations]."""
        samples = self.mended.samples
        truth = samples.new_tensor([self.truth[name] for name in self.mended.names])
        return float(((samples.mean(0) - truth) / samples.std(0)).abs().max())


def run(seed: int, out: Path, budget: Budget) -> Outcome:
    """The demonstration on the rig of this seed; all files go to ``out``."""
    start = time.monotonic()
    _title("1. The rig is measured: torque commands, encoder readings, a hidden effect")
    made = measure(seed, budget.protocol)
    problem = write_problem(made, out)
    print(f"{len(made.runs)} runs of {float(made.times[-1]):g} s in {out / 'measurements.csv'}")
    _title("2. compare: where does the model fail?")
    compared = command("compare", problem, out / "compare")
    _title("3. diagnose: which physical effect is missing?")
    command("diagnose", problem, out / "diagnose")
    _title("4. refine: add it, refit, until nothing more is missing")
    criticism = command("refine", problem, out / "refine")
    _title("5. What the runs say of each model's parameters; policies in worlds drawn from that, equal budgets")
    wrong, mended = branches((worlds_of(compared), worlds_of(criticism)), made.truth, seed, budget, out)
    outcome = Outcome(seed, made.truth, criticism, wrong, mended, time.monotonic() - start)
    write_atomic(out / "demo.json", json.dumps(as_json(outcome), indent=1) + "\n")
    return outcome


def command(name: Question, problem_file: Path, out: Path) -> Criticism:
    """Run ``onlinebayes NAME problem.toml --out DIR`` in this process, and return its result."""
    print(f"$ onlinebayes {name} {problem_file} --out {out}", flush=True)
    problem = load_problem(problem_file)
    result = criticise(name, problem)
    files = write_report(result, out, title="driven pendulum", problem=problem.path)
    print(summary(result, out, [file for file in files if file.startswith("refined")]), flush=True)
    return result


def branches(
    models: Sequence[ModelMixture], truth: Mapping[str, float], seed: int, budget: Budget, out: Path
) -> tuple[Branch, Branch]:
    """:func:`branch` for the wrong and the mended model."""
    jobs = [
        (worlds, dict(truth), seed, budget, name, out / FOLDERS[name])
        for worlds, name in zip(models, (WRONG, MENDED), strict=True)
    ]
    if budget.processes == 1:
        wrong, mended = (branch(*job) for job in jobs)
        return wrong, mended
    # Spawned, not forked: MuJoCo and PyTorch hold threads by now.
    with ProcessPoolExecutor(budget.processes, mp_context=get_context("spawn")) as pool:
        first, second = (pool.submit(branch, *job) for job in jobs)
        return first.result(), second.result()


def branch(worlds: ModelMixture, truth: Mapping[str, float], seed: int, budget: Budget, name: str, out: Path) -> Branch:
    """Policy and episodes on the rig for the worlds that the runs leave open under one model, recorded in ``out``."""
    torch.set_num_threads(1)
    logging.getLogger("torchrl").setLevel(logging.WARNING)
    say, belief, space = _teller(name), worlds.belief, worlds.space
    balancing, objective = learner(worlds.simulator, belief, budget.training, seed)
    shown = player(balancing, objective.policy, truth)
    files = PolicyFiles(out, "demo", objective, balancing)
    with Journal(out, "demo", BoxUniform(space), shown, known(space, truth), say=say, watchers=(files,)) as journal:

        def judge() -> dict[str, float]:
            return {"return": score(objective.policy, truth, budget.episodes, seed)}

        def told(frames: int, losses: dict[str, float]) -> None:
            journal.step("policy", frames=frames, losses=losses, figures=judge())

        journal.step("begin", figures=judge())
        journal.step("belief", belief=belief, figures=judge())
        train(balancing, objective, budget.training, seed, told)
    played = episodes(objective.policy, truth, budget.episodes, seed)
    angle = torch.atan2(played["observation"][..., 1], played["observation"][..., 0])
    samples = belief.sample((4000,), torch.Generator().manual_seed(0))
    return Branch(space.names, samples, angle, returns(played))


def as_json(outcome: Outcome) -> dict[str, object]:
    """The figures of the table."""
    error, (difference, se) = outcome.criticism.heldout_error, outcome.advantage
    return {
        "seed": outcome.seed,
        "verdict": outcome.criticism.verdict,
        "accepted": list(outcome.criticism.accepted),
        "heldout_error": {
            "before": error.before[SIGNAL],
            "after": error.after[SIGNAL],
            "noise_floor": error.noise_floor[SIGNAL],
        },
        "returns": {"wrong": outcome.wrong.returns.tolist(), "mended": outcome.mended.returns.tolist()},
        "advantage": {"mean": difference, "se": se},
        "seconds": outcome.seconds,
    }


def _title(text: str) -> None:
    print(f"\n{text}", flush=True)


def _teller(name: str) -> Callable[[str], None]:
    return lambda text: print(f"  {name}: {text}", file=sys.stderr, flush=True)
