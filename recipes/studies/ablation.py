"""``make ablation``: is the answer better with each rule of the search than without it?

Each rule is taken out by itself, and the same blind cases are judged with it and without it. A case in which both give
the same verdict and names says nothing for the rule.

    python -m recipes.studies.ablation [--rules ...]  -> docs/results/ablation.json

``make ablation-numbers`` asks the same of two rules on machines of which only numbers are off.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from envs.rigs import RIGS
from onlinebayes.criticism import answer
from onlinebayes.criticism.hypotheses import additions, original_integrator, search, weighing
from onlinebayes.experiments import STOPPED, status
from onlinebayes.identification.fitting import discretisation, window_length
from onlinebayes.identification.judging import evaluator, rule
from onlinebayes.runs import ResultTable
from recipes.studies.blind_rigs.judging import judge, unanswered
from recipes.studies.blind_rigs.plan import Job, jobs
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.jobs import check_names, each_kept_or_done, finished, record
from recipes.studies.reliability import statements

FIRST = 60_000
"""Seed of a rig's first case: none of these has been looked at."""

WHOLE = "nothing"


def _unsure(found: Any, gained: Any, *, noise_left: bool = False) -> str | None:
    del noise_left
    return rule.refusal(found, gained)


def _kept(explanation: Any, *_: Any) -> tuple[Any, tuple[str, ...]]:
    return explanation, ()


def one_by_one(*args: Any) -> tuple[additions.WiderBounds, ...]:
    """The wider bounds of each parameter by itself."""
    return tuple(additions.WiderBounds((one,)) for wider in additions.wider_bounds(*args) for one in wider.ranges)


RULES: Mapping[str, Callable[[], None]] = {
    WHOLE: lambda: None,
    "integration with a margin of stability": lambda: setattr(discretisation, "MARGIN", math.inf),
    "shorter windows where the model errs grossly": lambda: setattr(window_length, "LOST", window_length.FAR),
    "what leaves noise is not uncertain": lambda: setattr(evaluator, "refusal", _unsure),
    "an effect at its end is refused": lambda: setattr(additions.AddedEffect, "at_end", lambda *_: False),
    "one law at all places": lambda: setattr(search, "at_every_place", lambda *_: iter(())),
    "what may be nothing goes": lambda: setattr(answer, "determined", _kept),
    "held-out runs take out": lambda: setattr(answer, "uncontradicted", lambda found, *_: answer.Uncontradicted(found)),
    "moments are believed where noise is left": lambda: setattr(original_integrator, "at_noise_floor", lambda _: True),
    "bounds are widened together": lambda: setattr(search, "wider_bounds", one_by_one),
    "a rival keeps a weight": lambda: setattr(weighing, "LEAST_WEIGHT", 0.0),
    "rivals far behind are given up": lambda: setattr(search, "RIVALS_MARGIN", 1e9),
}
"""Rule -> takes it out of the process that it is called in; each job has a process of its own."""


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    rules: tuple[str, ...] = tuple(RULES)
    """which are taken out; ``nothing`` is always judged, too"""
    effects: int = 1
    """cases of each rig that hide effects"""
    own: int = 0
    """in which a number of the model is off"""
    surplus: int = 0
    """in which the model has a passive term that the machine lacks"""
    rigs: tuple[str, ...] = tuple(RIGS)
    """which rigs"""
    processes: int = 2
    """that share the cases"""
    minutes: float = 1.5
    """of processor time after which refine gives the best answer so far"""
    name: str = "ablation"
    """of the table"""
    out: Path = Path("out/ablation")
    """folder of the cases"""
    results: Path = Path("docs/results")
    """folder of the table"""


def judged_without(name: str, job: Job, budget: float) -> dict[str, Any]:
    """The record of a case that is judged without a rule, with a budget of processor time [s]."""
    RULES[name]()
    return judge(job, budget)


def tabulate(name: str, cases: Mapping[tuple[str, str], Judged], rules: Sequence[str]) -> ResultTable:
    """For each rule: how many answers differ without it, and how many are right with it and without."""
    table = ResultTable(name, f"make {name}", [FIRST])
    whole = {job: case for (left_out, job), case in cases.items() if left_out == WHOLE}
    for left_out in rules:
        pairs = [(whole[job], case) for (out, job), case in cases.items() if out == left_out and job in whole]
        if left_out == WHOLE or not pairs:
            continue
        differ = sum((a.verdict, {*a.accepted}) != (b.verdict, {*b.accepted}) for a, b in pairs)
        table.add(f"{left_out}: other answers without it", differ, spread=f"of {len(pairs)} cases")
        right, without = (sum(not (one.missed or one.ended) for one in side) for side in zip(*pairs, strict=True))
        table.add(f"{left_out}: right answers with it", right, spread=f"without it {without}")
        false, others = (
            sum(not any(said.right) for one in side for said in statements(one)) for side in zip(*pairs, strict=True)
        )
        table.add(f"{left_out}: names with it that are not in the machine", false, spread=f"without it {others}")
        spent, saved = (sum(one.seconds for one in side) for side in zip(*pairs, strict=True))
        table.add(f"{left_out}: processor time with it over without", spent / max(saved, 1e-9), unit="times")
    return table


def main(study: Study) -> int:
    """Judge what is not judged yet, and write the table."""
    check_names(study.rules, RULES)
    rules = tuple(dict.fromkeys((WHOLE, *study.rules)))
    check_names(study.rigs, RIGS)
    cases = jobs({"effect": study.effects, "own": study.own, "surplus": study.surplus}, study.rigs, FIRST)
    asked = {(name, job): partial(judged_without, name, job, 60 * study.minutes) for job in cases for name in rules}
    places = {name: str(k) for k, name in enumerate(RULES)}
    found = each_kept_or_done(
        "ablation",
        study.out,
        asked,
        lambda key: f"{places[key[0]]}-{key[1].name}",
        processes=study.processes,
        limit=240 * study.minutes,
        failed=lambda key, why: unanswered(key[1], why),
    )
    judged = {(name, job.name): record(Judged, result) for (name, job), result in found.items()}
    finished(tabulate(study.name, judged, rules), study.results, found)
    return STOPPED if found.stopped else 0


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
