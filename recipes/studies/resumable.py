"""What a study of many cases needs to go on where it was stopped: the records it kept, and a mark of what made them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar, final

import envs
import onlinebayes
import recipes
from onlinebayes.experiments import workers_of
from onlinebayes.runs import BadInput, Progress, ResultTable, commit, write_atomic
from onlinebayes.trainers.distributed import Here

K = TypeVar("K", bound=Hashable)
R = TypeVar("R")
UNKNOWN = "unknown"


def kept(folder: Path, wanted: Iterable[str], read: Callable[[str], R]) -> dict[str, R]:
    """The records of a folder, by name: ``NAME.json`` each; one that cannot be read is made anew.

    Args:
        folder: where they are.
        wanted: names of those that are asked for.
        read: text -> record; raises ``ValueError`` or ``TypeError`` where it is none.
    """
    found = {}
    for name in wanted:
        try:
            found[name] = read((folder / f"{name}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError, TypeError):
            continue
    return found


def check_names(told: Iterable[str], known: Iterable[str]) -> None:
    """Refuse names that a study does not know.

    Raises:
        BadInput: there is one.
    """
    if unknown := sorted(set(told) - set(known)):
        raise BadInput(f"{', '.join(unknown)} is unknown", f"known: {', '.join(known)}")


def printed_by(target: str, study: Any) -> str:
    """What a table says it was printed by: ``make TARGET``, and whether only a part of it was asked for.

    Args:
        target: of make.
        study: a dataclass that has a default for everything.
    """
    places, own, whole = {"out", "results", "policies", "ray_workers"}, asdict(study), asdict(type(study)())
    some = any(own[name] != whole[name] for name in own if name not in places)
    return f"make {target}{' (a part)' if some else ''}"


@final
class Found(dict[K, dict[str, Any]]):
    """What each job gave, by key.

    Args:
        results: by key.
        commit: of the code that did the jobs; several where it was not the same code.
    """

    def __init__(self, results: Mapping[K, dict[str, Any]], commit: str) -> None:
        super().__init__(results)
        self.commit = commit


def each_kept_or_done(
    label: str,
    folder: str | Path,
    jobs: Mapping[K, Callable[[], dict[str, Any]]],
    named: Callable[[K], str],
    ray_workers: int = 0,
) -> Found[K]:
    """What each job gives, from its file where it was done before, be it by another process meanwhile.

    What other code has done is kept, and said: a study of hours outlives a comment that is changed.

    Args:
        label: of the progress.
        folder: of the files.
        jobs: by key; on Ray they travel by pickle, and one whose worker dies is done again.
        named: key -> name of its file, without ``.json``.
        ray_workers: that do the jobs; 0: this process does, one after the other.
    """
    files, begun = {key: Path(folder) / f"{named(key)}.json" for key in jobs}, list[K]()
    mark, own = code_mark([onlinebayes, envs, recipes]), commit() or UNKNOWN
    Path(folder).mkdir(parents=True, exist_ok=True)

    def missing() -> Iterator[Callable[[], dict[str, Any]]]:
        for i, (key, file) in enumerate(files.items()):
            if not file.exists():
                progress.update(i, named(key))
                begun.append(key)
                yield jobs[key]

    with closing(workers_of(ray_workers) or Here()) as workers, Progress(label, len(jobs)) as progress:
        for number, result in workers.work(_call, missing()):
            write_atomic(files[begun[number]], json.dumps({**result, "code": mark, "commit": own}))
    found = {key: json.loads(file.read_text(encoding="utf-8")) for key, file in files.items()}
    commits = {result.pop("commit", UNKNOWN) for result in found.values()} or {own}
    if others := sum(result.pop("code", None) != mark for result in found.values()):
        print(f"{label}: other code did {others} of {len(found)} jobs in {folder}; delete their files to do them anew")
    return Found(found, ", ".join(sorted(commits)))


def commit_of(codes: Iterable[str], mark: str) -> str | None:
    """The commit that runs; None where other code made some of the records that are kept.

    Args:
        codes: marks of the code that made each record.
        mark: of the code that runs, by :func:`code_mark`.
    """
    return commit() if all(code == mark for code in codes) else None


def _call(job: Callable[[], R]) -> R:
    return job()


def code_mark(packages: Iterable[ModuleType], *settings: str) -> str:
    """Twelve digits that change with any ``.py`` or ``.xml`` of these packages, and with the settings."""
    digest = hashlib.sha256(" ".join(settings).encode())
    for package in packages:
        folder = Path(str(package.__file__)).parent
        for file in sorted(path for path in folder.rglob("*") if path.suffix in (".py", ".xml")):
            digest.update(str(file.relative_to(folder)).encode() + file.read_bytes())
    return digest.hexdigest()[:12]


def print_rows(table: ResultTable) -> None:
    """Every row of a table on one line, with whether its goal was met."""
    for row in table.rows:
        held = {None: "", True: "holds", False: "MISSED"}[row.holds]
        value = row.value if isinstance(row.value, str) else f"{row.value:.3g}"
        print(f"{row.name}: {value} | {row.spread or ''} | {row.unit} | {row.goal or ''} {held}".rstrip())
