"""``make change``: does the belief follow a machine that changes, and leave one alone that does not?

| part   | what is done                                                                                       |
|--------|----------------------------------------------------------------------------------------------------|
| drawn  | three trajectories of one machine, then three of another one drawn from the prior                     |
| small  | the same; the other one lies a fifth of the prior's width away, in a direction of its own               |
| same   | runs of thirty trajectories of one machine                                                         |
| words  | pendulums that stay, change between trajectories, change within one, or have a hidden dry friction |

One network a system, fitted on 1000 simulations of an untrained policy over the whole prior, reads for all: the
belief given all trajectories together (as a run without a ``Hazard`` has it), given the three new ones alone, and ours.
Sensors have 1 % noise. Each finished job is kept.

    python -m recipes.studies.change [--tasks pendulum] [--parts drawn]       -> docs/results/change.json
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import torch
from jaxtyping import Float
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs import step_mdp
from torchrl.envs.utils import ExplorationType, set_exploration_type

from onlinebayes.experiments import status
from onlinebayes.inference import (
    Alarm,
    Density,
    Hazard,
    History,
    NeuralEstimator,
    RunLengths,
    TruncatedMixture,
)
from onlinebayes.inference.calibration import credibility_of
from onlinebayes.inference.distributions.algebra import doubled
from onlinebayes.parameters import ParameterSpace
from onlinebayes.runs import ResultTable, generator
from onlinebayes.trainers import Listed
from onlinebayes.trainers.trajectories import trajectories
from onlinebayes.transforms import ParameterRandomization
from recipes.studies.jobs import each_kept_or_done, finished, printed_by
from recipes.studies.one_round import OneRound, begun, mixture
from recipes.studies.ringing import SIZES, measured

Part = Literal["drawn", "small", "same", "words"]
TASKS = ("cartpole", "pendulum", "acrobot")
NOISE, SIMULATIONS, SEED = 0.01, 1000, 701
BEFORE, AFTER, LONG, STEP, LEVEL = 3, 3, 30, 0.2, 0.95
SHORT = 3
"""Trajectories of sets that are read together."""

FRICTION = 0.6
"""Of the largest dry friction of ``ringing``, 0.5 N m: a pendulum's motor has 2 N m."""


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    tasks: tuple[str, ...] = TASKS
    """which recipes"""
    parts: tuple[Part, ...] = ("drawn", "small", "same", "words")
    """which parts"""
    pairs: int = 100
    """pairs of machines of a part"""
    runs: int = 20
    """machines of the other parts"""
    out: str = "out/change"
    """finished jobs go here"""
    results: Path = Path("docs/results")
    """folder of the table"""


def main(study: Study) -> int:
    """Do what is missing, print the table."""
    jobs: dict[str, Any] = {}
    for task in study.tasks:
        jobs |= {f"{task}, {kind}": partial(changed, task, kind, study.pairs) for kind in ("drawn", "small")}
        jobs[f"{task}, same"] = partial(same, task, study.runs)
    jobs["pendulum, words"] = partial(words, study.runs)
    jobs = {name: job for name, job in jobs.items() if name.split(", ")[1] in study.parts}
    found = each_kept_or_done("change", study.out, jobs, lambda name: name.replace(", ", "_"))
    return finished(tabled(found, printed_by("change", study)), study.results, found)


@cache
def fitted(task: str) -> tuple[OneRound, NeuralEstimator, TensorDict]:
    """The system, its network and the network's simulations."""
    draw, one = begun(SEED), OneRound.of(task, SEED, NOISE)
    simulated, estimator = one.simulated(SIMULATIONS), mixture(one, one.filtered())
    estimator.fit(simulated, generator=draw)
    return one, estimator, simulated


def changed(task: str, kind: str, pairs: int) -> dict[str, Any]:
    """Machines that change once: what is known of the new one, and whether the change was said."""
    one, estimator, _ = fitted(task)
    draw = generator(SEED, kind)
    before = one.problem.prior.sample((pairs,), draw)
    after = one.problem.prior.sample((pairs,), draw) if kind == "drawn" else moved(before, one.problem.space, draw)
    new = of_machines(one, after, AFTER, 12)
    data = torch.cat([of_machines(one, before, BEFORE, 11), new], dim=1)
    histories, ours = followed(estimator, data)
    result: dict[str, Any] = {"said": [[change.after for change in history.changes] for history in histories]}
    for name, belief in (("together", estimator.each(data)), ("alone", estimator.each(new)), ("ours", ours)):
        result[f"density {name}"] = [float(one.log_prob(theta)) for one, theta in each(belief, after)]
        result[f"region {name}"] = [
            float(credibility_of(one, theta, samples=2000, generator=draw)) for one, theta in each(belief, after)
        ]
    return result


def same(task: str, runs: int) -> dict[str, Any]:
    """Machines that stay: is a change said, and how wide is the belief beside the one without hypotheses?"""
    one, estimator, _ = fitted(task)
    draw = generator(SEED, "same")
    theta = one.problem.prior.sample((runs,), draw)
    data = of_machines(one, theta, LONG, 14)
    histories, ours = followed(estimator, data)
    wide = [
        width(belief) / width(plain) for belief, (plain, _) in zip(ours, each(estimator.each(data), theta), strict=True)
    ]
    inside = [float(credibility_of(belief, truth, generator=draw)) <= LEVEL for belief, truth in each(ours, theta)]
    return {"said": [[change.after for change in h.changes] for h in histories], "wider": wide, "inside": inside}


def words(runs: int) -> dict[str, Any]:
    """Return the verdicts on pendulums that stay, change, change within a trajectory, or have a hidden friction."""
    one, estimator, simulated = fitted("pendulum")
    draw = generator(SEED, "words")
    alarm, prior = Alarm(estimator.loss.embedding, simulated), one.problem.prior
    first, second = prior.sample((runs,), draw), prior.sample((runs,), draw)
    old, new = of_machines(one, first, 5, 21), of_machines(one, second, 5, 22)
    friction = SIZES["pendulum"][0]
    rows = first.repeat_interleave(10, 0)
    rubbed = measured(one, friction, rows, torch.full((len(rows), 1), FRICTION).to(rows), 23)
    kinds = {
        "stay": of_machines(one, first, 10, 24),
        "change": torch.cat([old, new], dim=1),
        "change within a trajectory": torch.cat([old, across(one, first, second, 25)[:, None], new], dim=1),
        "have a hidden friction": rubbed.unflatten(0, (runs, 10)),
    }
    result = {}
    for kind, data in kinds.items():
        histories, _ = followed(estimator, data.select(*KEYS, "mask"), alarm)
        result[kind] = [verdict(history) for history in histories]
    return result


KEYS = ("observation", "action", ("next", "observation"))


def verdict(history: History) -> str:
    """Return the kind of a history's verdict."""
    if history.unexplained:
        return "either" if history.changes else "lacks an effect"
    within = any(change.within for change in history.changes)
    return ("changed within" if within else "changed") if history.changes else "the same"


def moved(theta: Float[Tensor, "B P"], space: ParameterSpace, draw: torch.Generator) -> Float[Tensor, "B P"]:
    """Theta a fifth of the prior's width away, in a random direction; turned round where that leaves the prior."""
    u, direction = space.to_unit(theta), torch.randn(theta.shape, generator=draw, dtype=theta.dtype)
    step = STEP * direction / direction.norm(dim=1, keepdim=True)
    step = torch.where((u + step < 0) | (u + step > 1), -step, step)
    return space.from_unit(u + step)


def of_machines(one: OneRound, theta: Float[Tensor, "G P"], n: int, which: int) -> TensorDict:
    """n trajectories of each machine (G, n, T), without their theta."""
    worlds, drawn = one.problem, ParameterRandomization(Listed(theta))
    env = worlds.worlds(len(theta), drawn, one.seed + which)
    torch.manual_seed(one.seed + which)
    return torch.stack([trajectories(env, one.policy, one.steps).exclude("theta") for _ in range(n)], dim=1)


def across(one: OneRound, first: Float[Tensor, "G P"], second: Float[Tensor, "G P"], which: int) -> TensorDict:
    """One trajectory (G, T) of machines that change half-way through it."""
    drawn, half = ParameterRandomization(Listed(first)), one.steps // 2
    env = one.problem.worlds(len(first), drawn, one.seed + which, with_state=True)
    torch.manual_seed(one.seed + which)
    with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
        begin = env.rollout(half, one.policy, break_when_any_done=False)
        at = step_mdp(begin[:, -1])
        at["theta"] = at["state", "theta"] = second  # of the state and of the world alike
        at = env.reset(at, set_state=True)
        end = env.rollout(one.steps - half, one.policy, break_when_any_done=False, auto_reset=False, tensordict=at)
    whole: TensorDict = torch.cat([part.select(*KEYS, ("next", "reward")) for part in (begin, end)], dim=1)
    whole["mask"] = torch.ones(whole.shape, dtype=torch.bool)
    return whole


def each(beliefs: Any, theta: Float[Tensor, "G P"]) -> list[tuple[Density, Tensor]]:
    """One belief with its truth after the other."""
    return [(beliefs[i], theta[i]) for i in range(len(theta))]


def followed(
    estimator: NeuralEstimator, data: TensorDict, alarm: Alarm | None = None
) -> tuple[list[History], list[TruncatedMixture]]:
    """Apply :class:`ChangingBelief` to G machines (G, n, T), all at once: a network reads sets in batches."""
    G, n = data.shape[:2]
    histories, told = (
        [History(RunLengths(Hazard())) for _ in range(G)],
        [dict[int, TruncatedMixture]() for _ in range(G)],
    )
    for t in range(n):
        wanted = [sorted({*history.lengths.begins, t}) for history in histories]
        now = tails(estimator, data[:, : t + 1], wanted)
        novelty = [(surprise.p,) for surprise in alarm.each(data[:, t])] if alarm is not None else [()] * G
        histories = [
            history.after(history.lengths.advanced(before, after), p)
            for history, before, after, p in zip(histories, told, now, novelty, strict=True)
        ]
        told = now
    return histories, [history.lengths.belief(now) for history, now in zip(histories, told, strict=True)]


def tails(
    estimator: NeuralEstimator, data: TensorDict, wanted: Sequence[Sequence[int]]
) -> list[dict[int, TruncatedMixture]]:
    """For each machine the posteriors from some trajectories on; short sets are read together, and long ones."""
    found, newest = [dict[int, TruncatedMixture]() for _ in wanted], data.shape[1]
    for least, most in ((1, SHORT), (SHORT + 1, newest)):
        rows = [(g, begin) for g, begins in enumerate(wanted) for begin in begins if least <= newest - begin <= most]
        if not rows:
            continue
        first = max(0, newest - most)
        sets = data[[g for g, _ in rows], first:].clone()
        after = torch.arange(first, newest) >= torch.tensor([begin for _, begin in rows])[:, None]
        read = estimator.each(sets.set("mask", sets["mask"] & after[..., None]))
        for i, (g, begin) in enumerate(rows):
            found[g][begin] = doubled(read[i])  # type: ignore[arg-type]
    return found


def width(belief: Density) -> float:
    """Mean over the parameters of the log width of the 95 % interval; as a width."""
    draws = belief.sample((20_000,), torch.Generator().manual_seed(0))
    ends = torch.quantile(draws, torch.tensor([0.025, 0.975]).to(draws), dim=0)
    return float((ends[1] - ends[0]).log().mean().exp())


def tabled(found: dict[str, dict[str, Any]], printed: str) -> ResultTable:
    """Rows of all jobs."""
    table = ResultTable("change", printed, [SEED])
    for name, result in found.items():
        task, part = name.split(", ")
        if part == "same":
            add_same(table, task, result)
        elif part == "words":
            for kind, said in result.items():
                counts = {word: said.count(word) for word in dict.fromkeys(said)}
                told = ", ".join(f"{count} {word}" for word, count in counts.items())
                table.add(f"pendulums that {kind}: what is said of {len(said)}", told)
        else:
            add_changed(table, f"{task}, {'a new machine' if part == 'drawn' else 'a small jump'}", result)
    return table


def add_changed(table: ResultTable, name: str, result: dict[str, Any]) -> None:
    """One system and kind of jump."""
    for way in ("together", "alone", "ours"):
        told = {"together": "all together", "alone": "the new ones alone", "ours": "ours"}[way]
        share = torch.tensor(result[f"region {way}"]).le(LEVEL).double().mean().item()
        goal = {"goal": "at least 0.9", "holds": share >= 0.9} if way == "ours" else {}
        table.add(f"{name}, {told}: truths in the 95 % region", share, **goal)  # type: ignore[arg-type]
        density = torch.tensor(result[f"density {way}"])
        table.add(f"{name}, {told}: log density", float(density.mean()), spread=float(density.median()), unit="nats")
    said = [bool(after) and abs(after[0] - BEFORE) <= 1 for after in result["said"]]
    table.add(f"{name}: changes said after three trajectories, at the right place within one", sum(said) / len(said))


def add_same(table: ResultTable, task: str, result: dict[str, Any]) -> None:
    """One system."""
    false, runs = sum(map(bool, result["said"])), len(result["said"])
    goal = runs // 20
    table.add(
        f"{task}, no change: false alarms in {runs} runs of {LONG}", false, goal=f"at most {goal}", holds=false <= goal
    )
    wider = torch.tensor(result["wider"])
    middle = float(wider.median())
    table.add(
        f"{task}, no change: width beside all together, median and largest",
        middle,
        spread=float(wider.max()),
        unit="times",
        goal="at most 1.05",
        holds=middle <= 1.05,
    )
    table.add(f"{task}, no change: truths in the 95 % region", sum(result["inside"]) / runs)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
