"""``make reliability``: is a name that is said with probability p in the machine in a share p of cases?

A statement is a name with its equals: one of them is in the machine. Right is a name that is the same law as what was
hidden, or a part of it; what only looks like it on this rig is wrong, here.

    p(statement) = 1 / (1 + e^-(b . x))      b fitted to the cases of ``--learn`` by ridge logistic regression
    c            = the 90 % quantile of |estimate - truth| / half its 90 % interval          over the same cases

    python -m recipes.studies.reliability --learn             cases to learn from -> b and c, into the library
    python -m recipes.studies.reliability                     other cases -> docs/results/reliability.json
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import fmean, median

import torch
from jaxtyping import Float
from torch import Tensor

import onlinebayes.criticism
from envs.rigs import KINDS, RIGS
from onlinebayes.criticism import Named, evidence, probability
from onlinebayes.experiments import STOPPED, status
from onlinebayes.runs import BadInput, ResultTable, commit, write_atomic
from recipes.studies.blind_rigs.judging import judge, unanswered
from recipes.studies.blind_rigs.names import COMPOSED, law
from recipes.studies.blind_rigs.plan import jobs
from recipes.studies.blind_rigs.record import Judged
from recipes.studies.jobs import each_kept_or_done, finished, record

LEARNT_FROM, JUDGED = 30_000, 40_000
"""Seeds of a rig's first case of each kind: what is learnt is judged on cases that it has not seen."""

RIDGE = 1.0
"""Precision of the coefficients' normal prior, beside which a coefficient of 1 is nothing special."""

BINS = 5
SURE = 0.95
LEARNT = Path(onlinebayes.criticism.__file__).parent / "findings" / "learnt.json"


@dataclass(frozen=True)
class Study:
    """Options of the study; the numbers of cases are for each rig.

    Args:
        effects: cases that hide one or two effects.
        null: that hide nothing.
        others: of each of the other kinds, faults of the log and short logs left out.
        learn: learn from cases of their own, in place of judging.
        processes: that share the cases.
        minutes: of processor time after which refine gives the best answer so far.
        out: folder of the cases.
        results: folder of the table.
    """

    effects: int = 16
    null: int = 2
    others: int = 2
    learn: bool = False
    processes: int = 2
    minutes: float = 5.0
    out: Path = Path("out/reliability")
    results: Path = Path("docs/results")


@dataclass(frozen=True)
class Statement:
    """A statement of refine, and which of its names are in the machine."""

    said: Named
    right: tuple[bool, ...]


def statements(judged: Judged) -> list[Statement]:
    """List the statements on a case."""
    found = []
    for fields in judged.named:
        said = record(Named, fields)
        names = (said.name, *said.equals)
        found.append(Statement(said, tuple(in_machine(judged.rig, judged.hidden, name) for name in names)))
    return found


def in_machine(rig: str, hidden: Sequence[str], name: str) -> bool:
    """Check whether a name is the same law as one that is hidden, or a part of it."""
    for key in hidden:
        whole = law(rig, key)
        effect, _, target = whole.partition("@")
        if law(rig, name) in (whole, *(f"{part}@{target}" for part in COMPOSED.get(effect, ()))):
            return True
    return False


def logistic(x: Float[Tensor, "N F"], right: Float[Tensor, " N"]) -> Float[Tensor, " F"]:
    """Coefficients by Newton's method; the first, of the constant, has no prior."""
    b, prior = x.new_zeros(x.shape[1]), torch.full((x.shape[1],), RIDGE, dtype=x.dtype)
    prior[0] = 1e-6
    for _ in range(50):
        p = torch.sigmoid(x @ b)
        slope = x.T @ (right - p) - prior * b
        b = b + torch.linalg.solve((x * (p * (1 - p))[:, None]).T @ x + prior.diag(), slope)
    return b


def learn(cases: Sequence[Judged]) -> None:
    """Fit the coefficients and the factor, and write them into the library."""
    said = [one for case in cases for one in statements(case)]
    x = torch.tensor([evidence(one.said) for one in said], dtype=torch.float64)
    right = torch.tensor([float(any(one.right)) for one in said], dtype=torch.float64)
    off = sorted(abs(one) for case in cases for one in case.deviations.values())
    factor = off[min(len(off) - 1, math.ceil(0.9 * (len(off) + 1)) - 1)]
    told = {
        "made_by": "python -m recipes.studies.reliability --learn",
        "commit": commit(),
        "cases": len(cases),
        "statements": len(said),
        "intervals": len(off),
        "coefficients": logistic(x, right).tolist(),
        "low": x.amin(0).tolist(),
        "high": x.amax(0).tolist(),
        "factor": factor,
    }
    write_atomic(LEARNT, json.dumps(told, indent=1) + "\n")
    print(json.dumps(told, indent=1))


def tabulate(cases: Sequence[Judged], printed_by: str) -> ResultTable:
    """Tabulate how often a statement is true, by how probable it was called."""
    table = ResultTable("reliability", printed_by, [JUDGED])
    table.add("cases", len(cases), goal=">= 200", holds=len(cases) >= 200)
    spent = sorted(case.seconds for case in cases)
    if spent:
        spread = f"{spent[0]:.0f} to {spent[-1]:.0f}"
        table.add(
            "processor time a case, median",
            median(spent),
            spread=spread,
            unit="s",
            goal="<= 15",
            holds=median(spent) <= 15,
        )
    said = [one for case in cases for one in statements(case)]
    pairs = ((probability(one.said), zip(one.said.weights, one.right, strict=True)) for one in said)
    ended = sum(bool(case.ended) for case in cases)
    late = sum(case.ended == "out of time" for case in cases)
    table.add("cases without an answer", ended, spread=f"out of time {late}")
    wrong = [case.name for case in cases if not all(any(one.right) for one in statements(case))]
    share = len(wrong) / max(1, len(cases) - ended)
    name = "cases in which something is named that is not in the machine"
    table.add(name, share, spread=", ".join(wrong), goal="<= 0.03", holds=share <= 0.03)
    _names(table, [(p * weight, right) for p, names in pairs for weight, right in names])
    _intervals(table, "90 % intervals that hold the truth", cases, goal=True)
    for rig in RIGS:
        _intervals(table, f"{rig}: 90 % intervals that hold the truth", [case for case in cases if case.rig == rig])
    return table


def _names(table: ResultTable, each: list[tuple[float, bool]]) -> None:
    """Rows of names, each with its probability and whether it is in the machine."""
    table.add("names said", len(each))
    each, error = sorted(each, key=lambda pair: pair[0]), 0.0
    for k in range(BINS):
        part = each[k * len(each) // BINS : (k + 1) * len(each) // BINS]
        if not part:
            continue
        p, share = fmean(one for one, _ in part), fmean(ok for _, ok in part)
        error += abs(p - share) * len(part) / len(each)
        name = f"names called {part[0][0]:.2f} to {part[-1][0]:.2f} probable: in the machine"
        table.add(name, share, spread=f"mean p {p:.2f}, {len(part)} names")
    table.add("calibration error", error, goal="<= 0.05", holds=error <= 0.05)
    if sure := [ok for p, ok in each if p >= SURE]:
        wrong = 1 - fmean(sure)
        name = f"names called at least {SURE:g} probable: wrong"
        table.add(name, wrong, spread=f"{len(sure)} names", goal="<= 0.05", holds=wrong <= 0.05)


def _intervals(table: ResultTable, name: str, cases: Sequence[Judged], *, goal: bool = False) -> None:
    """A row of how many intervals hold the truth, where there are any."""
    if off := [abs(one) for case in cases for one in case.deviations.values()]:
        held, spread = fmean(one <= 1 for one in off), f"{len(off)} intervals"
        inside = 0.87 <= held <= 0.93 if goal else None
        table.add(name, held, spread=spread, goal="0.87 to 0.93" if goal else "", holds=inside)


def main(study: Study) -> int:
    """Judge what is not judged yet; learn from it, or write the table.

    Raises:
        BadInput: there is nothing learnt that could be judged.
    """
    if not study.learn and not LEARNT.exists():
        raise BadInput(f"{LEARNT.name} is missing", "run python -m recipes.studies.reliability --learn first")
    counts = {"effect": study.effects, "null": study.null, "wiring": 0, "short": 0}
    chosen = {kind: counts.get(kind, study.others) for kind in KINDS}
    asked = {
        job: partial(judge, job, 60 * study.minutes)
        for job in jobs(chosen, RIGS, LEARNT_FROM if study.learn else JUDGED)
    }
    folder = study.out / ("learn" if study.learn else "judge")
    limit = 4 * 60 * study.minutes
    found = each_kept_or_done(
        "reliability", folder, asked, lambda job: job.name, processes=study.processes, limit=limit, failed=unanswered
    )
    cases = sorted((record(Judged, result) for result in found.values()), key=lambda judged: judged.name)
    if study.learn:
        learn(cases)
    else:
        finished(tabulate(cases, "make reliability"), study.results, found)
    return STOPPED if found.stopped else 0


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
