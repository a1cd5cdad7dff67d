"""Short forms of the Fetch recipes, and what their studies are made of."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from envs.fetch import FRICTION, ScriptedPusher
from onlinebayes.experiments import run
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from recipes import fetch_push, fetch_reach, fetch_slide
from recipes.fetch import Success, fetch, outcomes
from recipes.studies import fetch as learning
from recipes.studies import fetch_friction, fetch_robustness

pytestmark = pytest.mark.usefixtures("without_shape_checks")


def rows(folder: Path) -> list[dict[str, str]]:
    assert {"run.json", "run.rrd", "run.html"} <= {path.name for path in folder.iterdir()}
    with (folder / "log.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
def test_reach_is_learnt_within_five_thousand_steps(tmp_path: Path) -> None:
    """The seed is fixed: no false failures on one machine; 128 episodes on exact worlds."""
    settings = fetch_reach.Settings(short=True, out=str(tmp_path))
    assert run("fetch_reach", fetch_reach.build, settings) == 0
    last = rows(tmp_path / "fetch_reach-oracle-0-short")[-1]
    assert int(last["frames"]) == 5000
    assert float(last["figure/success"]) == 1.0


@pytest.mark.parametrize(
    "recipe",
    [pytest.param(fetch_push, marks=pytest.mark.slow), pytest.param(fetch_slide, marks=pytest.mark.long)],
    ids=["push", "slide"],
)
def test_short_forms_connect_all_pieces(recipe, tmp_path: Path) -> None:
    """Too short to learn from: what is asked is that all is there and finite."""
    name = recipe.__name__.split(".")[-1]
    assert run(name, recipe.build, recipe.Settings(short=True, out=str(tmp_path))) in (0, 1)
    found = rows(tmp_path / f"{name}-online-0-short")
    assert [row["step"] for row in found] == ["1", "2"]
    for row in found:
        figures = [float(value) for key, value in row.items() if key.startswith("figure/")]
        assert torch.tensor(figures).isfinite().all()
        assert "narrowed" in row["notes"] or "widened" in row["notes"]


def test_the_seed_alone_decides_the_worlds_that_judge() -> None:
    made = fetch("push", ParameterSpace({FRICTION: Parameter(0.1, 2.0)}))
    first, second = (outcomes(made.lean, ScriptedPusher(), made.lean.prior, 3, seed=5) for _ in range(2))
    assert torch.equal(first.theta, second.theta)
    assert torch.equal(first.reached, second.reached)


def test_a_job_goes_on_where_it_was_stopped_and_with_the_same_settings_only(tmp_path: Path, monkeypatch) -> None:
    case, looks = replace(learning.CASES["reach"], batches=3, worlds=2), []

    def stopped(*_args) -> Success:
        looks.append(torch.get_rng_state())
        if len(looks) == 2:
            raise KeyboardInterrupt
        return Success(0.0, 0.0, 0.0, 0.0)

    monkeypatch.setattr(learning, "success", stopped)
    with pytest.raises(KeyboardInterrupt):
        learning.policy_of(case, 1, tmp_path)
    _, course = learning.policy_of(case, 1, tmp_path)
    assert [look["frames"] for look in course] == [100, 200, 300]
    assert not torch.equal(looks[0], looks[2]), "it does not draw the same numbers again"
    with pytest.raises(BadInput, match="begun with other settings"):
        learning.policy_of(replace(case, elsewhere=0.1), 1, tmp_path)


def test_the_protocol_has_the_same_starts_for_every_theta() -> None:
    question = fetch_friction.Question("push", 2, (0.1, 1.0), 0.0)
    made = fetch("push", fetch_friction.space_of(question))
    data = fetch_friction.trajectories(made, ScriptedPusher(), question, 3, seed=0)
    assert data["observation"].shape == (3, 50, 50)
    first = data["observation"][:, 0]
    assert torch.equal(first, first[:1].expand_as(first))
    assert not torch.equal(first[:, 3:5], first[:, 28:30])
    assert data["theta"][:, 0].unique().numel() == 3
    assert float((data["next", "observation"][0, -1] - data["next", "observation"][1, -1]).abs().max()) > 1e-3


@pytest.mark.long
def test_policies_of_the_prior_and_online_are_judged_along_the_friction(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(fetch_push, "LONG", fetch_push.SHORT)
    monkeypatch.setattr(fetch_robustness, "EPISODES", 2)
    study = fetch_robustness.Study(tasks=("push",), out=str(tmp_path / "runs"), results=tmp_path)
    assert fetch_robustness.main(study) in (0, 1)
    rows = {row["name"]: row["value"] for row in json.loads((tmp_path / "fetch-robustness.json").read_text())["rows"]}
    assert rows["push: steps of each run"] == (fetch_push.SHORT.first + fetch_push.SHORT.batches) * 3200
    assert all(0 <= rows[f"push, {kind}: success near the hidden friction"] <= 1 for kind in ("prior", "online"))
    assert {"figure-4.6.png", "figure-5.3.png"} <= {path.name for path in tmp_path.iterdir()}
