"""What a study of many cases needs to go on where it was stopped: the records it kept, and a mark of what made them."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

from onlinebayes.runs import ResultTable, write_atomic

R = TypeVar("R")


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


def kept_or_done(path: Path, job: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """What the job gave, from its file where it was done before."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, json.dumps(job()))
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result


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
