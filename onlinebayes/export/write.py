"""What ``refine`` found, written for the place where people train; see :data:`TARGETS`."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from onlinebayes.export.document import document
from onlinebayes.export.drawn import drawn
from onlinebayes.export.mujoco import MODEL, mujoco_part
from onlinebayes.problems import load_worlds
from onlinebayes.runs import BadInput, together, write_atomic
from onlinebayes.simulators.mujoco import MujocoSimulator

WORLDS = "worlds.json"

TARGETS = ("json", "mujoco", "playground", "mjlab", "isaaclab")
"""``json``: worlds.json alone; the others: with refined.xml and a module that draws worlds there."""

MODULES = Path(__file__).parent / "modules"


def files_of(target: str) -> tuple[str, ...]:
    """Names of the files that an export to a target writes."""
    return (WORLDS,) if target == "json" else (WORLDS, MODEL, f"worlds_{target}.py")


def export(
    folder: str | Path, target: str, out: str | Path, note: Callable[[str], None] = lambda _line: None
) -> tuple[str, ...]:
    """Write the export, all files together.

    Args:
        folder: that ``refine`` wrote to; posterior.json in it is used where it lies there.
        target: one of :data:`TARGETS`.
        out: folder for the files; made where it is missing.
        note: told in one line what a reader should know.

    Returns:
        Names of the files.

    Raises:
        BadInput: the folder cannot be used, or the model is none of MuJoCo's.
    """
    models = load_worlds(folder)
    found, simulator = drawn(Path(folder), models), models.worlds.simulator
    if not models.correlated and found.source == "report.json":
        note("report.json is of an earlier version without correlations: parameters are drawn apart; run refine again")
    part = None
    if isinstance(simulator, MujocoSimulator):
        part = mujoco_part(simulator, found, Path(out))
    elif target != "json":
        cure = "export it with --to json"
        raise BadInput(f"the model is none of MuJoCo's, as {target} needs", cure, where=str(folder))
    left_out = {} if part is None else part.left_out
    for effect, why in left_out.items():
        note(f"{effect} is left out of {MODEL}, {why}; worlds.json has it")
    content = document(models, found, left_out)
    if part is not None:
        content |= {"mujoco": part.section, "actuators": part.actuators}
    names = files_of(target)
    with together():
        Path(out).mkdir(parents=True, exist_ok=True)
        if part is not None and MODEL in names:
            for name, bytes_ in part.assets.items():
                write_atomic(Path(out) / name, bytes_)
            head = "<!-- exported by onlinebayes, at the mean of the draws in worlds.json -->\n"
            write_atomic(Path(out) / MODEL, head + (_for_older_mujoco(part.xml) if target == "mjlab" else part.xml))
            write_atomic(Path(out) / names[-1], module_text(target, content))
        write_atomic(Path(out) / WORLDS, _json(content))
    return names


def _for_older_mujoco(xml: str) -> str:
    """The text without what only says which setpoint a single command is: MuJoCo 3.11, which mjlab takes, lacks it."""
    return re.sub(r'(<general [^>]*?) input="(?:pos|vel)"', r"\1", xml)


def module_text(target: str, content: dict[str, Any]) -> str:
    """The target's module, with the table of the parameters' places as comments before its imports."""
    text = (MODULES / f"{target}_worlds.py").read_text("utf-8")
    lines = ["# parameter: mean, sd [unit] -> places in MuJoCo's model"]
    for name, one in content["parameters"].items():
        cells = [cell for cell in content["mujoco"]["cells"] if name in (cell["slope"] or {})]
        places = ", ".join(f"{c['field']} of {c['name'] or c['kind']} x {c['slope'][name]:g}" for c in cells)
        where = places or f"no straight line, or no term: {one['effect'] or 'see worlds.json'}"
        lines.append(f"# {name}: {one['mean']:.6g}, {one['sd']:.2g} [{one['unit']}] -> {where}")
    begin = "from __future__ import annotations"
    table = "\n".join(line.encode("unicode_escape").decode() for line in lines)
    return text.replace(begin, f"{table}\n\n{begin}", 1)


def _json(content: dict[str, Any]) -> str:
    """JSON with one line for each row of numbers."""
    lines = []
    for key, value in content.items():
        if key in ("correlation", "draws"):
            lines.append(f'"{key}": {_rows(value)}')
        elif key == "mujoco":
            rest = ",\n".join(
                f'"{k}": {_rows(v) if k in ("cells", "values") else json.dumps(v, ensure_ascii=False)}'
                for k, v in value.items()
            )
            lines.append(f'"mujoco": {{\n{rest}\n}}')
        else:
            lines.append(f'"{key}": {json.dumps(value, ensure_ascii=False, allow_nan=False, indent=1)}')
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _rows(rows: list[Any]) -> str:
    return "[\n" + ",\n".join(json.dumps(row, ensure_ascii=False, allow_nan=False) for row in rows) + "\n]"
