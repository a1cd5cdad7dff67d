"""``make messy``: refine on machines on which one or two effects dominate and six to ten small ones lie beside them.

    fall    = mean over signals of 1 - after / before,          held-out errors [of what the base model errs]
    share   = fall with what was accepted / fall with what dominates, fitted,             between 0 and 1

Held-out errors are those of :mod:`onlinebayes.identification.judging.held_out`, for the base model, for each further
addition in the order in which it was accepted, and for what dominates. An addition makes them worse where the mean over
signals of after / before exceeds 1.02. Where what dominates takes away less than a third of the error of every signal,
it does not dominate, and the case is counted in no row but the first two and the last.

Every case is kept in a file of its own, so that a study that was stopped goes on. Seeds of 8900 and more were looked at
while the machines were made.

    python -m recipes.studies.messy --first 8000 --cases 48
"""

from __future__ import annotations

import statistics
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from envs.rigs import RIGS, BlindCase, messy_case, messy_machine
from onlinebayes.criticism import (
    Addition,
    Criticism,
    Evaluation,
    FitRequest,
    Hypothesis,
    Search,
    additions,
    begun_as_read,
    flexible,
    held_out_errors,
    prepare,
    wider_bounds,
)
from onlinebayes.experiments import STOPPED, status
from onlinebayes.problems import ProblemFile
from onlinebayes.runs import UNWATCHED, BadInput, ResultTable, one_torch_thread, processor_time
from recipes.studies.blind_rigs.judging import loaded, refined
from recipes.studies.blind_rigs.names import answer, law, spelt
from recipes.studies.blind_rigs.table import Goal, add_share
from recipes.studies.jobs import each_kept_or_done, print_rows, record
from recipes.studies.spawned import Failed

WORSE = 1.02
LEAST_FALL = 1 / 3
NOTHING = 0.02
MOST_NAMED = 3


@dataclass(frozen=True)
class Study:
    """Options of the study."""

    first: int = 8000
    """seed of the first case"""
    cases: int = 48
    """how many; the rigs take turns"""
    out: Path = Path("out/messy")
    """a file for each finished case goes here"""
    results: Path = Path("docs/results")
    """of the table"""
    processes: int = 2
    """at once"""
    minutes: float = 15.0
    """on the clock that a case may take, with the fits of its judge; one that takes longer has no answer"""

    @property
    def names(self) -> list[str]:
        """``rig-seed`` of its cases."""
        return [f"{list(RIGS)[seed % len(RIGS)]}-{seed}" for seed in range(self.first, self.first + self.cases)]


@dataclass(frozen=True)
class Found:
    """Result of refine on one case.

    Args:
        name: ``rig-seed``.
        hidden: what dominates, in the library's names.
        small: what lies beside it.
        ended: empty, or why there is no answer.
        verdict, accepted: what refine said.
        contradicted: what was added and taken out again for the held-out runs.
        equal: what the first accepted one cannot be told from.
        errors: held-out errors with nothing added, and with one accepted addition more each [mean over signals of
            after / before]; shorter where one cannot be fitted again.
        reference: the same with what dominates; None where it cannot be fitted.
        shows: after / before with what dominates, of the signal that falls most.
        floors: held-out error of the base model, the worst signal's [noise floors].
        seconds: of processor time that refine took; on the clock where it was ended.
    """

    name: str
    hidden: tuple[str, ...]
    small: tuple[str, ...]
    ended: str = ""
    verdict: str = ""
    accepted: tuple[str, ...] = ()
    contradicted: tuple[str, ...] = ()
    equal: tuple[str, ...] = ()
    errors: tuple[float, ...] = ()
    reference: float | None = None
    shows: float = 1.0
    floors: float | None = None
    seconds: float = 0.0

    @property
    def counts(self) -> bool:
        """True if the dominating effect lowers the held-out error enough to dominate."""
        return self.reference is not None and 1 - self.shows >= LEAST_FALL

    @property
    def named_first(self) -> bool:
        """True if the first accepted addition is what dominates, one of two, or a part of one."""
        return any(self.kind_of(key) == "dominating" for key in self.accepted[:1])

    @property
    def named_or_tied(self) -> bool:
        """The same, or it is said that it cannot be told from it."""
        return self.named_first or (
            self.verdict == "tie" and any(self.kind_of(key) == "dominating" for key in self.equal)
        )

    @property
    def all_named(self) -> bool:
        """True if all that dominates was accepted."""
        rig = self.name.rpartition("-")[0]
        return all(answer(rig, key).found(self.accepted) for key in self.hidden)

    @property
    def false(self) -> tuple[str, ...]:
        """The accepted effects that are not there."""
        return tuple(key for key in self.accepted if self.kind_of(key) == "false")

    @property
    def small_first(self) -> bool:
        """True if a small one was accepted first."""
        return any(self.kind_of(key) == "small" for key in self.accepted[:1])

    @property
    def worse(self) -> bool:
        """True if an accepted addition makes the held-out runs worse."""
        return any(after > WORSE * before for before, after in pairwise(self.errors))

    @property
    def share(self) -> float | None:
        """See the module; None where what dominates lowers one signal's error at the cost of the others'."""
        if self.reference is None or 1 - self.reference < NOTHING:
            return None
        return min(max((1 - self.errors[-1]) / (1 - self.reference), 0.0), 1.0)

    def kind_of(self, key: str) -> str:
        """``dominating``, ``small`` or ``false``."""
        rig = self.name.rpartition("-")[0]
        if any(answer(rig, hidden).admits(key) for hidden in self.hidden):
            return "dominating"
        return "small" if any(answer(rig, small).admits(key) for small in self.small) else "false"


def main(study: Study) -> int:
    """Run what is missing, print the table; returns the exit status."""
    found = each_kept_or_done(
        "messy",
        study.out,
        {name: partial(ask, name) for name in study.names},
        str,
        processes=study.processes,
        limit=60 * study.minutes,
        failed=unanswered,
    )
    table = tabulate([record(Found, result) for result in found.values()], study.first)
    table.commit = found.commit
    print_rows(table)
    print(f"written: {table.write(study.results)}")
    return STOPPED if found.stopped else 0


def unanswered(name: str, failed: Failed) -> dict[str, Any]:
    """A case that refine gave no answer to."""
    rig, _, seed = name.rpartition("-")
    mess, _ = messy_machine(rig, int(seed))
    hidden, small = (tuple(spelt(key, mess.truth) for key in keys) for keys in (mess.keys, chain(*mess.small)))
    return asdict(Found(name, hidden, small, ended=failed.problem, seconds=failed.seconds))


def ask(name: str) -> dict[str, Any]:
    """One case, by name: its truth is looked at only after the search."""
    rig, _, seed = name.rpartition("-")
    with one_torch_thread():
        made = messy_case(rig, int(seed))
        hidden = tuple(spelt(key, made.truth) for key in made.hidden)
        small = tuple(spelt(key, made.truth) for key in made.small)
        began = processor_time()
        try:
            problem = loaded(made)
            result = refined(problem)
        except BadInput as error:
            ended = str(error).splitlines()[0]
            return asdict(Found(name, hidden, small, ended=ended, seconds=processor_time() - began))
        return asdict(judged(Found(name, hidden, small, seconds=processor_time() - began), made, problem, result))


def judged(case: Found, made: BlindCase, problem: ProblemFile, result: Criticism) -> Found:
    """The case with what refine said of it, and what that is worth on the held-out runs."""
    judge = Judge.of(problem)
    errors = [1.0]
    for count in range(1, len(result.accepted) + 1):
        if (parts := judge.parts(result.accepted[:count])) is None:
            break
        errors.append(statistics.fmean(parts))
    known = judge.named(made.rig, case.hidden)
    reference = None if known is None else judge.parts(known)
    floors = result.heldout_error
    first = next((c.indistinguishable_from for c in result.candidates if c.effect in result.accepted[:1]), ())
    return Found(
        case.name,
        case.hidden,
        case.small,
        verdict=result.verdict,
        accepted=result.accepted,
        contradicted=result.contradicted,
        equal=first,
        errors=tuple(errors),
        reference=None if reference is None else statistics.fmean(reference),
        shows=1.0 if reference is None else min(reference),
        floors=max((value / floors.noise_floor[name] for name, value in floors.before.items()), default=None),
        seconds=case.seconds,
    )


@dataclass(frozen=True)
class Judge:
    """Fits additions by name, and says what they do to the held-out runs.

    Args:
        search: that stands at the base model.
        pool: name -> addition.
        held: held-out error of a fit, by signal [its unit].
        before: that of the base model.
    """

    search: Search
    pool: Mapping[str, Addition]
    held: Callable[[Evaluation], Mapping[str, float]]
    before: Mapping[str, float]

    @staticmethod
    def of(problem: ProblemFile) -> Judge:
        """Of a problem, prepared as refine does."""
        task = prepare(problem.simulator, problem.measurement, problem.holdout, problem.selection, problem.scope)
        task, search = begun_as_read(task, UNWATCHED)
        base = search.base
        every = (
            *wider_bounds(base.fitted.simulator, base.values),
            *additions(search.evaluator.given, task.fit_runs),
            *flexible(search.evaluator.given, task.fit_runs),
        )

        def held(evaluation: Evaluation) -> Mapping[str, float]:
            return held_out_errors(search.evaluator, evaluation, task.held_runs, search.evaluator.windows.horizon)

        return Judge(search, {one.key: one for one in every}, held, held(base))

    def parts(self, keys: Sequence[str]) -> list[float] | None:
        """After / before of every signal; None where these cannot be fitted."""
        if any(key not in self.pool for key in keys):
            return None
        base, hypothesis = self.search.base, Hypothesis(tuple(self.pool[key] for key in keys))
        given = self.search.evaluator.given
        values = [base.values]
        for key in keys:
            simulator = self.pool[key].joined(given, self.search.evaluator.runs)
            values += [{**base.values, **start.values} for start in self.pool[key].starts(simulator, base.values)]
        found = self.search.evaluator.evaluate(FitRequest(hypothesis, values, base.fitted.lin.starts))
        if found is None:
            return None
        after = self.held(found)
        return [after[name] / before for name, before in self.before.items() if before > 0]

    def named(self, rig: str, hidden: Sequence[str]) -> list[str] | None:
        """Name the dominating effects as candidates; None where one of them is none."""
        found = []
        for key in hidden:
            if key in self.pool:
                found.append(key)
                continue
            parts = answer(rig, key).parts or (frozenset([law(rig, key)]),)
            known = [next((name for name in self.pool if law(rig, name) in part), None) for part in parts]
            if None in known:
                return None
            found += [name for name in known if name is not None]
        return list(dict.fromkeys(found))


def tabulate(cases: Iterable[Found], first: int) -> ResultTable:
    """The figures with their goals, and every case that is not right."""
    table, found = ResultTable("messy", "make messy", [first]), list(cases)
    fair = [one for one in found if one.counts and not one.ended]
    table.add("cases", len(found), spread=f"{sum(bool(one.ended) for one in found)} without an answer")
    table.add("cases in which what dominates takes away a third of a signal's error", len(fair))
    two = [one for one in fair if len(one.hidden) == 2]
    _share(table, "what dominates accepted first", fair, lambda one: one.named_first, Goal(least=0.9))
    _share(table, "what dominates accepted first, or tied with the first", fair, lambda one: one.named_or_tied)
    _share(table, "two that dominate: both accepted", two, lambda one: one.all_named)
    _share(table, "a small one accepted first", fair, lambda one: one.small_first)
    _share(table, "something accepted that is not there", fair, lambda one: bool(one.false))
    _share(table, "something accepted that makes held-out runs worse", fair, lambda one: one.worse, Goal(most=0.05))
    gone = Counter(one.kind_of(key) for one in fair for key in one.contradicted)
    table.add("taken out for the held-out runs", ", ".join(f"{n} {kind}" for kind, n in gone.items()) or "nothing")
    _share(table, "at most three accepted", fair, lambda one: len(one.accepted) <= MOST_NAMED, Goal(least=1.0))
    _share(table, "insufficient_data", fair, lambda one: one.verdict == "insufficient_data", Goal(most=0.0))
    if fair:
        shares, goal = [share for one in fair if (share := one.share) is not None], Goal(least=0.8)
        share = statistics.fmean(shares or [0.0])
        name = "share of the fall of the held-out error that what dominates gives"
        table.add(name, share, unit=f"mean of {len(shares)}", goal=str(goal), holds=goal.holds(share))
        left = statistics.median(one.errors[-1] for one in fair)
        table.add("held-out error, after / before, median", left)
        known = statistics.median(one.reference for one in fair if one.reference is not None)
        table.add("the same with what dominates", known)
        floors = statistics.median(one.floors for one in fair if one.floors is not None)
        table.add("held-out error of the base model, median", floors, unit="noise floors")
        verdicts = Counter(one.verdict for one in fair)
        table.add("verdicts", ", ".join(f"{count} {verdict}" for verdict, count in verdicts.most_common()))
    if found:
        seconds = [one.seconds for one in found]
        table.add("time, median", statistics.median(seconds), spread=f"to {max(seconds):.0f}", unit="CPU s")
    for one in found:
        if one.ended or (one.counts and (not one.named_first or one.worse or one.false)):
            table.add(f"MISS {one.name}", ", ".join(one.hidden), unit=told(one))
    return table


def told(one: Found) -> str:
    """Describe the result of refine on a case."""
    if one.ended:
        return f"no answer: {one.ended}"
    parts = [f"{one.verdict}: {', '.join(one.accepted) or 'nothing'}"]
    parts += [f"equal: {', '.join(one.equal)}"] if one.equal else []
    parts += [f"not there: {', '.join(one.false)}"] if one.false else []
    known = "" if one.reference is None else f", with what dominates {one.reference:.2f}"
    return "; ".join([*parts, f"held-out {' '.join(f'{error:.2f}' for error in one.errors)}{known}"])


def _share(
    table: ResultTable, name: str, of: Sequence[Found], rule: Callable[[Found], bool], goal: Goal | None = None
) -> None:
    add_share(table, name, sum(map(rule, of)), len(of), goal)


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
