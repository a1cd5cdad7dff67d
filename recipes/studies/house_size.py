"""``make house-size``: lines and numeric constants of each room of criticism, now and at an earlier revision.

    lines       all lines of a room's Python files, empty ones and docstrings too
    constants   names that a module sets at its top level to a value with a number in it: LEAST_GAIN = 0.05

A number inside a function is not counted, before as little as now; 0 and 1 alone are counted, as every number is. Where
a revision is counted as well, the table of both is written into docs/criticism-before-and-after.md.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from onlinebayes.runs import BadInput, ResultTable, write_atomic
from recipes.command import status

HOUSE = "onlinebayes/criticism"
LOOSE = "files in no room"
DECIDES_NOTHING = ("experiment", "report")
"""Rooms that plan the next recording and write files: the search and its rules stand in all others."""
NEW = "hypotheses"
"""The room of the new search, which stood beside the old one for a while: what came before is counted without it."""
MOST_LINES = 5000
"""The search and its rules are to take no more."""
BEGIN, END = "<!-- printed by make house-size -->\n", "<!-- end of what is printed -->"


@dataclass(frozen=True)
class Study:
    """What is counted."""

    revision: str = ""
    """a revision of git to count as well, such as b3213e2, the last one with the old search"""
    results: Path = Path("docs/results")
    """folder of house-size.json"""
    page: Path = Path("docs/criticism-before-and-after.md")
    """where the table of both stands, between two marks"""


@dataclass
class Size:
    """Lines and constants."""

    lines: int = 0
    constants: int = 0

    def plus(self, other: Size) -> Size:
        """Both together."""
        return Size(self.lines + other.lines, self.constants + other.constants)


def constants(text: str) -> int:
    """How many names a module sets to a value with a number in it."""
    found = 0
    for statement in ast.parse(text).body:
        if isinstance(statement, ast.Assign | ast.AnnAssign) and statement.value is not None:
            found += any(_is_number(node) for node in ast.walk(statement.value))
    return found


def _is_number(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def sizes(files: Iterator[tuple[str, str]]) -> dict[str, Size]:
    """Room -> its size, in the order of names.

    Args:
        files: (path within the house, text).
    """
    rooms: defaultdict[str, Size] = defaultdict(Size)
    for path, text in files:
        room = path.partition("/")[0] if "/" in path else LOOSE
        rooms[room] = rooms[room].plus(Size(len(text.splitlines()), constants(text)))
    return dict(sorted(rooms.items()))


def of_the_tree(root: Path) -> Iterator[tuple[str, str]]:
    """The files as they lie there."""
    house = root / HOUSE
    for path in sorted(house.rglob("*.py")):
        yield path.relative_to(house).as_posix(), path.read_text(encoding="utf-8")


def of_a_revision(root: Path, revision: str) -> Iterator[tuple[str, str]]:
    """The files as git has them.

    Raises:
        BadInput: git does not know the revision.
    """
    for path in _git(root, "ls-tree", "-r", "--name-only", revision, "--", HOUSE).splitlines():
        if path.endswith(".py"):
            yield path.removeprefix(f"{HOUSE}/"), _git(root, "show", f"{revision}:{path}")


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BadInput(done.stderr.strip() or "git failed", "name a revision of this clone; a shallow one has few")
    return done.stdout


def table(now: dict[str, Size], before: dict[str, Size], revision: str) -> ResultTable:
    """The figures; ``before`` is empty where no revision was asked for."""
    results = ResultTable("house-size", f"make house-size REVISION={revision}", [0])
    for room in sorted({*now, *before}):
        _rows(results, room, now.get(room, Size()), before.get(room, Size()) if before else None, revision)
    _rows(results, "all rooms", total(now), total(before) if before else None, revision)
    search = total(now, DECIDES_NOTHING)
    old = total(before, (*DECIDES_NOTHING, NEW)) if before else None
    _rows(results, "the search and its rules", search, old, revision, f" without `{NEW}`")
    results.add("goal of lines", f"{search.lines}", goal=f"at most {MOST_LINES}", holds=search.lines <= MOST_LINES)
    if old is not None:
        share = search.constants / old.constants
        results.add("goal of constants", share, unit="of before", goal="at most 0.5", holds=share <= 0.5)
    return results


def _rows(results: ResultTable, name: str, now: Size, before: Size | None, revision: str, but: str = "") -> None:
    for what in ("lines", "constants"):
        past = None if before is None else f"{getattr(before, what)} at {revision}{but}"
        results.add(f"{name}: {what}", f"{getattr(now, what)}", spread=past)


def total(rooms: dict[str, Size], left_out: tuple[str, ...] = ()) -> Size:
    """Of all rooms but some."""
    found = Size()
    for room, size in rooms.items():
        found = found if room in left_out else found.plus(size)
    return found


def side_by_side(now: dict[str, Size], before: dict[str, Size]) -> str:
    """Both as a table in Markdown, and what of them is the search and its rules."""
    rows = [(room, before.get(room, Size()), now.get(room, Size())) for room in sorted({*now, *before})]
    rows.append(("all", total(before), total(now)))
    deciding = total(before, (*DECIDES_NOTHING, NEW)), total(now, DECIDES_NOTHING)
    rows.append(("the search and its rules", *deciding))
    lines = ["| room | lines before | lines after | constants before | constants after |", "|---|---|---|---|---|"]
    lines += [f"| {name} | {a.lines} | {b.lines} | {a.constants} | {b.constants} |" for name, a, b in rows]
    return "\n".join(lines) + "\n"


def main(study: Study) -> None:
    """Count, write and print."""
    root = Path(__file__).parents[2]
    before = sizes(of_a_revision(root, study.revision)) if study.revision else {}
    now = sizes(of_the_tree(root))
    results = table(now, before, study.revision)
    path = results.write(study.results)
    print(results.to_markdown())
    print(f"written: {path}")
    if before:
        head, _, rest = study.page.read_text(encoding="utf-8").partition(BEGIN)
        write_atomic(study.page, head + BEGIN + side_by_side(now, before) + END + rest.partition(END)[2])
        print(f"written: {study.page}")


if __name__ == "__main__":
    sys.exit(status(main, Study, __doc__))
