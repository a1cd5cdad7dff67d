"""A blind case as files: model.xml, log.csv and problem.toml for the command line, truth.json for the judge."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from envs.rigs.cases import BlindCase
from onlinebayes.runs import write_atomic


def write_case(case: BlindCase, folder: str | Path) -> Path:
    """Write a case, and return the path of its problem file.

    Args:
        case: the case.
        folder: made where it is missing. What it hides goes to ``truth.json``, which no other file names.

    Raises:
        BadInput: the folder cannot be written.
    """
    folder = Path(folder)
    write_atomic(folder / "model.xml", case.xml)
    write_atomic(folder / "log.csv", _table(case))
    write_atomic(folder / "problem.toml", _problem(case))
    write_atomic(folder / "truth.json", json.dumps(_truth(case), indent=1) + "\n")
    return folder / "problem.toml"


def _table(case: BlindCase) -> str:
    header = next(iter(case.columns.values()))
    lines = ["run," + ",".join(header)]
    for run, table in case.columns.items():
        rows = np.column_stack(list(table.values())).tolist()
        lines += [f"{run}," + ",".join(f"{value:.9g}" for value in row) for row in rows]
    return "\n".join(lines) + "\n"


def _problem(case: BlindCase) -> str:
    held = ", ".join(f'"{run}"' for run in case.holdout)
    lines = [
        "schema = 1",
        'model = "model.xml"',
        'measurements = ["log.csv"]',
        *([f"holdout = [{held}]"] if held else []),
        "",
        "[parameters]",
    ]
    lines += [f'"{name}" = [{low!r}, {high!r}]' for name, (low, high) in case.parameters.items()]
    for signal, (sd, resolution) in case.noise.items():
        lines += ["", f'[signals."{signal}"]', f"sd = {sd!r}"]
        lines += [f"resolution = {resolution!r}"] if resolution else []
    return "\n".join(lines) + "\n"


def _truth(case: BlindCase) -> dict[str, object]:
    return {
        "rig": case.rig,
        "kind": case.kind,
        "seed": case.seed,
        "hidden": list(case.hidden),
        "level": case.level,
        "partners": list(case.partners),
        "fault": case.fault,
        "truth": dict(case.truth),
        "small": list(case.small),
    }
