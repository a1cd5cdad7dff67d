"""``onlinebayes refine MODEL LOG``: what ``init`` would write goes into the output folder, and is used.

What the draft leaves open ends the command, with the file in place: it is filled in, and given in the place of the two.
A file that somebody wrote or changed there is left alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from onlinebayes.cli.init import tell
from onlinebayes.cli.outputs import check_apart, writable
from onlinebayes.problems.drafting import Draft, draft
from onlinebayes.runs import BadInput, Stages, write_atomic

DRAFT = "problem.toml"
"""Its name in the output folder; no command writes one of that name otherwise."""


def drafted(command: str, model: str, logs: Sequence[str], out: str) -> str:
    """Write the draft, say what was matched, and return its path.

    Args:
        command: that will use it.
        model: path of an MJCF or URDF file.
        logs: paths of tables, at least one.
        out: the command's folder.

    Raises:
        BadInput: the model or a log cannot be read, the draft is not complete, or another problem file is there.
    """
    target = Path(out) / DRAFT
    check_apart([target], {**{Path(log): "a log" for log in logs}, Path(model): "the model"})
    use = f"onlinebayes {command} {target} --out {out}"
    with writable(Path(out), (DRAFT,)):
        with Stages() as say:
            made = draft(Path(model), [Path(log) for log in logs], target, say)
        if target.exists() and target.read_text(encoding="utf-8", errors="replace") != made.text:
            raise BadInput(
                "is there already, and is not this draft", f"use it ({use}) or choose another --out", where=str(target)
            )
        write_atomic(target, made.text)
    tell(made, target)
    if found := _open(made):
        raise BadInput(f"the draft leaves open {found}", f"fill it in, then {use}", where=str(target))
    return str(target)


def _open(made: Draft) -> str:
    """What keeps a draft from being used, in words; empty where nothing does."""
    names = [*made.missing, *(f"the free joint {joint}" for joint in made.fixed)]
    if not names:
        return "how the clocks of the logs belong together" if made.untied else ""
    return f"which columns are {', '.join(names[:3])}{f' and {len(names) - 3} more' if len(names) > 3 else ''}"
