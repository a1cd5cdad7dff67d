"""A folder as ``refine`` leaves it, made without a fit: an arm with a servo, and a belief with correlations."""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

ARM = """
<mujoco model="arm"><compiler angle="radian"/><option timestep="0.005" integrator="implicitfast"/><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.2" armature="0.01"/>
    <geom name="rod" type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.8"/>
    <body name="fore" pos="0.3 0 0"><joint name="elbow" axis="0 1 0" damping="0.1"/>
      <inertial pos="0.1 0 0" mass="0.4" diaginertia="0.002 0.003 0.004"/></body></body></worldbody>
  <actuator><motor name="lift" joint="shoulder"/><position name="bend" joint="elbow" kp="20" kv="1"/></actuator>
</mujoco>"""

PROBLEM = """
schema = 1
model = "arm.xml"
measurements = ["arm.csv"]
[parameters]
"body.fore.mass" = [0.1, 2.0]
"joint.shoulder.damping" = [0.0, 2.0]
"actuator.bend.kp" = [1.0, 60.0]
"""

NAMES = ("body.fore.mass", "joint.shoulder.damping", "actuator.bend.kp", "dry_friction@shoulder.frictionloss")
MEAN = (0.5, 0.3, 25.0, 0.2)
SD = (0.02, 0.05, 1.0, 0.04)
CORRELATION = ((1.0, 0.6, 0.0, 0.0), (0.6, 1.0, 0.0, -0.8), (0.0, 0.0, 1.0, 0.0), (0.0, -0.8, 0.0, 1.0))


def table() -> str:
    """Two short runs: what is drawn does not depend on them."""
    rows = ["run,time,ctrl.lift,ctrl.bend,qpos.shoulder,qpos.elbow"]
    for run in ("first", "second"):
        rows += [f"{run},{0.01 * k:.2f},0,{math.sin(k):.3f},{0.01 * k:.3f},{0.1 * math.sin(k):.4f}" for k in range(201)]
    return "\n".join(rows) + "\n"


def hypothesis(
    accepted: Sequence[str],
    names: Sequence[str] = NAMES,
    mean: Sequence[float] = MEAN,
    sd: Sequence[float] = SD,
    correlation: Sequence[Sequence[float]] = CORRELATION,
    weight: float = 1.0,
) -> dict[str, Any]:
    """One of a report's."""
    parameters = {name: {"mean": m, "sd": s} for name, m, s in zip(names, mean, sd, strict=True)}
    belief = {"names": names, "mean": mean, "sd": sd, "correlation": correlation}
    return {"weight": weight, "accepted": accepted, "parameters": parameters, "belief": belief}


def refined(folder: Path, *models: tuple[Sequence[str], dict[str, Any]], **more: Any) -> Path:
    """The folder of these models: what each adds, and its hypothesis."""
    folder.mkdir(exist_ok=True)
    (folder / "arm.xml").write_text(ARM)
    (folder / "arm.csv").write_text(table())
    for k, (added, _) in enumerate(models):
        name = "refined.toml" if k == 0 else f"refined-{k + 1}.toml"
        (folder / name).write_text(f"{PROBLEM}\n[effects]\nadd = {json.dumps(added)}\n")
    told = [one for _, one in models]
    report = {"verdict": "missing_effect", "hypotheses": told, "parameters": told[0]["parameters"], **more}
    (folder / "report.json").write_text(json.dumps(report))
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Of one model with dry friction at the shoulder."""
    effects = ["dry_friction@shoulder"]
    return refined(tmp_path / "refined", (effects, hypothesis(effects)))


def loaded(path: Path) -> ModuleType:
    """A module that was exported, as somebody else would import it."""
    spec = importlib.util.spec_from_file_location(f"{path.stem}_{abs(hash(path))}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def alike(
    draws: np.ndarray, mean: Sequence[float], sd: Sequence[float], correlation: Sequence[Sequence[float]]
) -> None:
    """Check draws (N, P) against a belief: four standard errors, which 1 of 1,000 such checks of 14 numbers fails."""
    n = len(draws)
    assert np.abs(draws.mean(0) - mean).max() < 4 * max(np.array(sd) / math.sqrt(n))
    for k in range(len(sd)):
        assert abs(draws[:, k].mean() - mean[k]) < 4 * sd[k] / math.sqrt(n)
        assert abs(draws[:, k].std() / sd[k] - 1) < 4 / math.sqrt(2 * n)
    expected = np.array(correlation)
    assert (np.abs(np.corrcoef(draws.T) - expected) <= 4 * (1 - expected**2) / math.sqrt(n) + 1e-9).all()


def cells(worlds: Mapping[str, Any], field: str) -> list[dict[str, Any]]:
    """The cells of one field."""
    return [cell for cell in worlds["mujoco"]["cells"] if cell["field"] == field]
