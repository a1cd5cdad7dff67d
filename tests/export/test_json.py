"""worlds.json: the belief as numbers, with the places of the parameters in the MJCF."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from onlinebayes.export import export
from onlinebayes.inference import saving
from onlinebayes.problems import load_worlds
from onlinebayes.runs import BadInput
from tests.export.conftest import CORRELATION, MEAN, NAMES, SD, alike, hypothesis, refined


def written(folder: Path, out: Path) -> dict:
    assert export(folder, "json", out) == ("worlds.json",)
    return json.loads((out / "worlds.json").read_text())


def test_draws_have_the_beliefs_mean_sd_and_correlation(folder: Path, tmp_path: Path) -> None:
    worlds = written(folder, tmp_path / "out")
    assert (worlds["schema"], worlds["version"]) == ("onlinebayes-worlds", 1)
    assert tuple(worlds["parameters"]) == NAMES
    draws = np.array(worlds["draws"])
    assert draws.shape == (256, 4)
    alike(draws, MEAN, SD, CORRELATION)
    told = worlds["parameters"].values()
    assert [one["mean"] for one in told] == pytest.approx(MEAN, rel=0.01)
    assert [one["sd"] for one in told] == pytest.approx(SD, rel=0.03)
    np.testing.assert_allclose(worlds["correlation"], CORRELATION, atol=0.03)
    assert worlds == written(folder, tmp_path / "again")


def test_it_says_where_each_parameter_stands(folder: Path, tmp_path: Path) -> None:
    worlds = written(folder, tmp_path / "out")
    damping = worlds["parameters"]["joint.shoulder.damping"]
    assert damping["element"] == {"kind": "joint", "names": ["shoulder"]}
    assert (damping["attribute"], damping["index"], damping["unit"]) == ("damping", None, "N m s/rad")
    assert (damping["low"], damping["high"]) == (0.0, 2.0)
    assert worlds["parameters"][NAMES[3]]["effect"] == "dry_friction@shoulder"
    (effect,) = worlds["effects"]
    assert effect["parameters"] == {"frictionloss": NAMES[3]}
    assert effect["in_mujoco"]
    assert (worlds["timestep"], worlds["source"]["belief"]) == (0.005, "report.json")


def test_draws_stay_within_the_bounds_and_do_not_pile_up_on_them(tmp_path: Path) -> None:
    near = hypothesis((), NAMES[:3], (0.5, 0.02, 25.0), (0.02, 0.05, 1.0), np.eye(3).tolist())
    draws = np.array(written(refined(tmp_path / "refined", ((), near)), tmp_path / "out")["draws"])
    assert draws[:, 1].min() > 0
    assert draws[:, 1].max() < 2


def test_draws_come_from_all_models_that_are_open(tmp_path: Path) -> None:
    first, second = ["dry_friction@shoulder"], ["quadratic_drag@shoulder"]
    told = (
        (first, hypothesis(first, weight=0.75)),
        (second, hypothesis(second, (*NAMES[:3], "quadratic_drag@shoulder.drag"), weight=0.25)),
    )
    worlds = written(refined(tmp_path / "refined", *told), tmp_path / "out")
    assert [one["weight"] for one in worlds["models"]] == [0.75, 0.25]
    names = list(worlds["parameters"])
    draws = np.array(worlds["draws"])
    friction, drag = (draws[:, names.index(name)] != 0 for name in (NAMES[3], "quadratic_drag@shoulder.drag"))
    assert (friction ^ drag).all()
    assert friction.mean() == pytest.approx(0.75, abs=0.11)  # four standard errors of 256


def test_a_posterior_beside_it_is_taken(folder: Path, tmp_path: Path) -> None:
    worlds = load_worlds(folder).worlds
    moved = type(worlds)(worlds.simulator, worlds.names, worlds.weight, worlds.mean * 1.1, worlds.covariance).belief
    saving.save(moved, folder / "belief.json")
    (folder / "posterior.json").write_text('{"models": [{"belief": "belief.json"}]}')
    told = written(folder, tmp_path / "out")
    assert told["source"]["belief"] == "posterior.json"
    assert [one["mean"] for one in told["parameters"].values()] == pytest.approx([1.1 * m for m in MEAN], rel=0.01)
    np.testing.assert_allclose(told["correlation"], CORRELATION, atol=0.03)


def test_a_report_without_correlations_is_said_to_have_none(folder: Path, tmp_path: Path) -> None:
    report = json.loads((folder / "report.json").read_text())
    del report["hypotheses"][0]["belief"]
    (folder / "report.json").write_text(json.dumps(report))
    notes: list[str] = []
    export(folder, "json", tmp_path / "out", note=notes.append)
    assert "without correlations" in notes[0]
    worlds = json.loads((tmp_path / "out" / "worlds.json").read_text())
    assert not worlds["source"]["correlations_known"]
    np.testing.assert_allclose(worlds["correlation"], np.eye(4), atol=0.03)


def test_what_cannot_be_used_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="holds no refined"):
        export(tmp_path, "json", tmp_path / "out")
    report = json.loads((folder / "report.json").read_text())
    (folder / "report.json").write_text(json.dumps(report | {"wiring": {"fault": "sign"}}))
    with pytest.raises(BadInput, match="run refine on its"):
        export(folder, "json", tmp_path / "out")
    report["hypotheses"][0]["belief"]["names"] = ["another"]
    (folder / "report.json").write_text(json.dumps(report))
    with pytest.raises(BadInput, match=r"report\.json cannot be read"):
        export(folder, "json", tmp_path / "out")
    assert not (tmp_path / "out").exists()
