"""The commands on real files, from a table to a report: awkward clocks, and a whole refine in the slow suite."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from onlinebayes.cli.main import main
from tests.problems.conftest import MODEL, PROBLEM

Rows = list[list[str]]


def jittering(rows: Rows) -> Rows:
    draw = random.Random(0)
    return [[run, f"{float(t) + draw.uniform(-0.004, 0.004):.5f}", u, q] for run, t, u, q in rows]


def with_a_gap(rows: Rows) -> Rows:
    return [row for row in rows if not 0.8 < float(row[1]) < 1.2]


def with_a_long_pause(rows: Rows) -> Rows:
    return [[run, t if float(t) < 1 else f"{float(t) + 300:.2f}", u, q] for run, t, u, q in rows]


def since_1970(rows: Rows) -> Rows:
    return [[run, f"{float(t) + 1.7e9:.2f}", u, q] for run, t, u, q in rows]


def with_a_slow_sensor(rows: Rows) -> Rows:
    return [[*row[:3], row[3] if k % 3 == 0 else ""] for k, row in enumerate(rows)]


def of_odd_steps(rows: Rows) -> Rows:
    return [[run, f"{float(t) * 0.77:.6f}", u, q] for run, t, u, q in rows]


def off_at_the_end(rows: Rows) -> Rows:
    return [[*row, "1" if float(row[1]) < 1.5 else "0"] for row in rows]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(change, marks=() if change is jittering else pytest.mark.long)
        for change in (
            jittering,
            with_a_gap,
            with_a_long_pause,
            since_1970,
            with_a_slow_sensor,
            of_odd_steps,
            off_at_the_end,
        )
    ],
)
def test_compare_takes_clocks_as_they_come(folder: Path, capsys, change: Callable[[Rows], Rows]):
    head, *lines = (folder / "carriage.csv").read_text().splitlines()
    rows = change([line.split(",") for line in lines])
    head += ",enable.motor" if len(rows[0]) == 5 else ""
    (folder / "carriage.csv").write_text("\n".join([head, *(",".join(row) for row in rows)]))
    assert main(["compare", str(folder / "carriage.toml"), "--out", str(folder / "out")]) == 0, capsys.readouterr().err
    assert {path.name for path in (folder / "out").iterdir()} == {"report.json", "report.html", "run.rrd"}
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["verdict"] == "insufficient_data"
    assert report["holdout_looks"] == 1
    assert report["heldout_error"]["before"]["qpos.carriage"] < 0.5


def rubbing_carriage(folder: Path, seconds: float = 20.0) -> None:
    """Two runs of the carriage with 1.5 N of dry friction that the model lacks, from plain MuJoCo at a fine step."""
    text = MODEL.replace('damping="2"', 'damping="3" frictionloss="1.5"').replace("0.005", "0.001")
    model, draw = mujoco.MjModel.from_xml_string(text), np.random.default_rng(0)
    rows = ["run,time,ctrl.motor,qpos.carriage"]
    for run in ("first", "second"):
        data, phase, size = mujoco.MjData(model), draw.uniform(0, 6.28, 5), draw.uniform(0.5, 1.5, 5)
        for k in range(round(seconds * 100)):
            command = float(
                np.round((size * np.sin(np.pi * np.array([0.3, 0.7, 1.3, 2.1, 3.7]) * k / 100 + phase)).sum(), 4)
            )
            rows.append(f"{run},{k / 100:.2f},{command},{data.qpos[0] + draw.normal(0, 1e-5):.6f}")
            data.ctrl[0] = command
            mujoco.mj_step(model, data, 10)
    (folder / "carriage.csv").write_text("\n".join(rows) + "\n")


@pytest.mark.slow
def test_refine_names_dry_friction_and_its_files_work(folder: Path, capsys):
    rubbing_carriage(folder)
    (folder / "carriage.toml").write_text(PROBLEM)
    out = folder / "out"
    assert main(["refine", str(folder / "carriage.toml"), "--out", str(out)]) == 0
    assert "missing:   dry_friction@carriage" in capsys.readouterr().out
    report = json.loads((out / "report.json").read_text())
    assert report["accepted"] == ["dry_friction@carriage"]
    error = report["heldout_error"]
    assert error["after"]["qpos.carriage"] < 0.2 * error["before"]["qpos.carriage"]
    mujoco.MjModel.from_xml_path(str(out / "refined.xml"))
    assert main(["compare", str(out / "refined.toml"), "--out", str(out / "again")]) == 0
    again = json.loads((out / "again" / "report.json").read_text())
    # Where friction sticks a second fit may end in a neighbouring valley, but in no worse one.
    assert again["heldout_error"]["before"]["qpos.carriage"] < 1.1 * error["after"]["qpos.carriage"]
