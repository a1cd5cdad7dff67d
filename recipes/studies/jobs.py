"""Jobs of a study by name, each kept in a file as soon as it is done: a study that was stopped goes on where it was."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, final

import envs
import onlinebayes
import recipes
from onlinebayes.experiments import workers_of
from onlinebayes.runs import BadInput, Progress, ResultTable, commit, source_digest, write_atomic
from onlinebayes.runs.memo import FOLDER
from onlinebayes.trainers.distributed import Here
from recipes.studies.spawned import Failed, spawned

K = TypeVar("K", bound=Hashable)
R = TypeVar("R")
UNKNOWN = "unknown"

NOTHING_KEPT: Mapping[str, str] = {**os.environ, FOLDER: "off"}
"""Environment of a command whose time or answer is judged: what an earlier one kept is neither its time nor its own."""


@dataclass(frozen=True, kw_only=True)
class Places:
    """The place where a study keeps its jobs, and the workers that do them."""

    out: str
    """finished jobs go here"""
    results: Path = Path("docs/results")
    """folder of the table"""
    ray_workers: int = 0
    """workers on Ray that do the jobs; 0: this process does, one after the other"""


@final
class Found(dict[K, dict[str, Any]]):
    """Results of the jobs, by key.

    Args:
        results: by key.
        commit: of the code that did the jobs; several where it was not the same code.
        stopped: whether some of them are missing, for the study was stopped.
    """

    def __init__(self, results: Mapping[K, dict[str, Any]], commit: str, stopped: bool = False) -> None:
        super().__init__(results)
        self.commit, self.stopped = commit, stopped


def each_kept_or_done(
    label: str,
    folder: str | Path,
    jobs: Mapping[K, Callable[[], dict[str, Any]]],
    named: Callable[[K], str],
    ray_workers: int = 0,
    *,
    processes: int = 0,
    limit: float = math.inf,
    failed: Callable[[K, Failed], dict[str, Any]] | None = None,
) -> Found[K]:
    """Return the result of each job, from its file where it was done before, be it by another process meanwhile.

    What other code has done is kept, and said: a study of hours outlives a comment that is changed.

    Args:
        label: of the progress.
        folder: of the files.
        jobs: by key; on Ray they travel by pickle, and one whose worker dies is done again.
        named: key -> name of its file, without ``.json``.
        ray_workers: that do the jobs; 0: this process does, one after the other.
        processes: that do the jobs in place of Ray's, each job in one of its own.
        limit: seconds on the clock that a job may take there [s].
        failed: what is kept of a job that gave no answer there. Such a study, when it is stopped, gives the part that
            is done.

    Raises:
        BadInput: no process at all is to do them where each may fail.
        RuntimeError: a job gave no answer, and none is kept of such ones.
    """
    if failed and processes < 1:
        raise BadInput(f"{processes} processes cannot do anything", "use one or more")
    files, begun = {key: Path(folder) / f"{named(key)}.json" for key in jobs}, list[K]()
    mark, own, stopped = code_mark([onlinebayes, envs, recipes]), commit() or UNKNOWN, False
    Path(folder).mkdir(parents=True, exist_ok=True)

    def missing() -> Iterator[Callable[[], dict[str, Any]]]:
        for i, (key, file) in enumerate(files.items()):
            if not file.exists():
                progress.update(i, named(key))
                begun.append(key)
                yield jobs[key]

    with ExitStack() as stack:
        progress = stack.enter_context(Progress(label, len(jobs)))
        done: Iterator[tuple[int, dict[str, Any] | Failed]]
        if processes:
            done = stack.enter_context(closing(spawned(missing(), processes, limit)))
        else:
            done = stack.enter_context(closing(workers_of(ray_workers) or Here())).work(_call, missing())
        try:
            for number, result in done:
                if isinstance(result, Failed):
                    if failed is None:
                        raise RuntimeError(f"{named(begun[number])}: {result.problem}")
                    result = failed(begun[number], result)
                write_atomic(files[begun[number]], json.dumps({**result, "code": mark, "commit": own}))
        except KeyboardInterrupt:
            if failed is None:
                raise
            stopped = True
    found = {key: json.loads(file.read_text(encoding="utf-8")) for key, file in files.items() if file.exists()}
    commits = {result.pop("commit", UNKNOWN) for result in found.values()} or {own}
    if others := sum(result.pop("code", None) != mark for result in found.values()):
        print(f"{label}: other code did {others} of {len(found)} jobs in {folder}; delete their files to do them anew")
    if stopped:
        print(f"stopped; {len(found)} of {len(jobs)} are kept in {folder}; the same command goes on", file=sys.stderr)
    return Found(found, ", ".join(sorted(commits)), stopped)


def record(kind: type[R], result: Mapping[str, Any]) -> R:
    """The dataclass of which a job gave the fields: lists become tuples, keys that it no longer has are passed over."""
    known = {entry.name for entry in fields(kind)}  # type: ignore[arg-type]
    return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in result.items() if k in known})


def check_names(told: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names that a study does not know.

    Raises:
        BadInput: there is one.
    """
    if unknown := sorted(set(told) - set(known)):
        raise BadInput(f"{', '.join(unknown)} is unknown", f"known: {', '.join(known)}")


def printed_by(target: str, study: Any) -> str:
    """Return the command that a table names as its printer: ``make TARGET``, and whether only a part was asked for.

    Args:
        target: of make.
        study: a dataclass that has a default for everything.
    """
    places = {"out", "results", "policies", "ray_workers", "processes"}
    own, whole = asdict(study), asdict(type(study)())
    some = any(own[name] != whole[name] for name in own if name not in places)
    return f"make {target}{' (a part)' if some else ''}"


def finished(table: ResultTable, results: Path, found: Found[Any] | None = None) -> int:
    """Write a table, print it, and give the exit status: 1 where a goal is missed.

    Args:
        table: with all its rows.
        results: folder of the table.
        found: the jobs that it rests on, where it does; they name the commits.
    """
    if found is not None:
        table.commit = found.commit
    print(table.to_markdown())
    print(f"written: {table.write(results)}")
    return 0 if table.holds else 1


def _call(job: Callable[[], R]) -> R:
    return job()


def code_mark(packages: Iterable[ModuleType]) -> str:
    """Twelve digits that change with any ``.py`` or ``.xml`` of these packages."""
    return source_digest(Path(str(package.__file__)).parent for package in packages)[:12]


def print_rows(table: ResultTable) -> None:
    """Every row of a table on one line, with whether its goal was met."""
    for row in table.rows:
        held = {None: "", True: "holds", False: "MISSED"}[row.holds]
        value = row.value if isinstance(row.value, str) else f"{row.value:.3g}"
        print(f"{row.name}: {value} | {row.spread or ''} | {row.unit} | {row.goal or ''} {held}".rstrip())
