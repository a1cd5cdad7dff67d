"""A planned experiment as files: next.csv to play, next.html to look at, next.json for programs."""

from __future__ import annotations

import io
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from onlinebayes.criticism import Plan, Tried
from onlinebayes.report.plan_page import to_page
from onlinebayes.runs import together, write_atomic
from onlinebayes.runs.results import versions

SCHEMA = 2
FILES = ("next.csv", "next.html", "next.json")


@together()
def write_plan(plan: Plan, out_dir: str | Path, *, title: str = "") -> tuple[str, ...]:
    """Write the three files, each atomically; next.json last, because programs wait for it.

    Args:
        plan: what is proposed.
        out_dir: folder; made if it is missing.
        title: what was criticised, for the page's head.

    Returns:
        Names of the files written.

    Raises:
        BadInput: the folder cannot be made or written.
    """
    folder = Path(out_dir)
    write_atomic(folder / "next.csv", to_csv(plan))
    write_atomic(folder / "next.html", to_page(plan, title=title))
    write_atomic(folder / "next.json", json.dumps(to_dict(plan), indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    return FILES


def to_csv(plan: Plan) -> str:
    """The command table: ``time`` [s] and a ``ctrl.<actuator>`` column each, held from row to row."""
    rows = np.concatenate([plan.time[:, None].cpu().numpy(), plan.command.cpu().numpy()], 1)
    text = io.StringIO()
    text.write(",".join(["time", *(f"ctrl.{name}" for name in plan.commands)]) + "\n")
    np.savetxt(text, rows, fmt="%.9g", delimiter=",")
    return text.getvalue()


def to_dict(plan: Plan) -> dict[str, Any]:
    """The content of next.json."""
    return {
        "schema": SCHEMA,
        "versions": versions(),
        "verdict": plan.verdict,
        "decides": plan.decides,
        "chosen": _tried(plan, plan.chosen),
        "seconds": round(float(plan.time[-1]), 9),
        "start": dict(zip(plan.joints, plan.start.tolist(), strict=True)),
        "recordings": plan.recordings,
        "rivalries": [asdict(rivalry) for rivalry in plan.rivalries],
        "tried": [_tried(plan, tried) for tried in plan.tried],
        "refused": plan.refused,
    }


def _tried(plan: Plan, tried: Tried) -> dict[str, Any]:
    sigma = [
        {"names": rivalry.names, "sigma": value, "gain": gain}
        for rivalry, value, gain in zip(plan.rivalries, tried.sigma, tried.gain, strict=True)
    ]
    return {**{key: value for key, value in asdict(tried).items() if key != "gain"}, "sigma": sigma}
