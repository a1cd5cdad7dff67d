"""The demonstration's path with tiny budgets; at full budget, its claim."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from envs.driven_pendulum import Protocol
from envs.driven_pendulum.rig import DAMPING, DELAY, MASS
from onlinebayes.experiments import closing_line
from onlinebayes.problems import load_problem
from onlinebayes.runs import atomic_path
from recipes.demo.__main__ import directions, table
from recipes.demo.measure import hidden_truth, measure, write_problem
from recipes.demo.picture import picture
from recipes.demo.run import QUICK, SIGNAL, Budget, Outcome, run
from recipes.studies.demo_seeds import HIDDEN, tabulate

torch.set_num_threads(1)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Outcome, Path]:
    out = tmp_path_factory.mktemp("demo")
    return run(0, out, QUICK), out


@pytest.mark.slow
def test_the_hidden_effect_is_named_and_the_held_out_error_falls(quick: tuple[Outcome, Path]) -> None:
    outcome, out = quick
    assert outcome.criticism.verdict == "missing_effect"
    assert outcome.criticism.accepted == (HIDDEN,)
    error = outcome.criticism.heldout_error
    assert error.after[SIGNAL] < 0.1 * error.before[SIGNAL]
    delay = outcome.criticism.parameters[f"{HIDDEN}.delay"]
    assert delay.mean == pytest.approx(outcome.truth[DELAY], abs=1e-3)
    for name in ("compare", "diagnose", "refine"):
        assert (out / name / "report.html").is_file()
        assert (out / name / "run.rrd").is_file()


@pytest.mark.slow
def test_both_models_get_posteriors_and_policies_of_equal_budget(quick: tuple[Outcome, Path]) -> None:
    outcome, out = quick
    assert outcome.wrong.names == (MASS, DAMPING)
    assert outcome.mended.names == (MASS, DAMPING, DELAY)
    for folder in (out, out / "as_it_was"):
        assert {"run.rrd", "run.html", "log.csv"} <= {path.name for path in folder.iterdir()}
    for branch in (outcome.wrong, outcome.mended):
        assert branch.samples.shape == (4000, len(branch.names))
        assert bool(branch.samples.isfinite().all())
        assert branch.returns.shape == (QUICK.episodes,)
        assert bool((branch.returns >= 0).all())


@pytest.mark.slow
def test_the_table_the_picture_and_the_files_tell_the_same(quick: tuple[Outcome, Path]) -> None:
    outcome, out = quick
    text = table(outcome)
    for branch in (outcome.wrong, outcome.mended):
        assert f"{float(branch.returns.mean()):.1f} ±" in text
    assert HIDDEN in text
    assert f"{1e3 * outcome.criticism.heldout_error.before[SIGNAL]:.1f} mrad" in text
    assert str(out / "refine" / "report.html") in directions(out)
    assert str(out / "refine" / "run.rrd") in directions(out)
    assert closing_line(out) in directions(out)
    with atomic_path(out / "demo.png") as path:
        picture(outcome).savefig(path, dpi=40)
    assert (out / "demo.png").stat().st_size > 5000
    told = json.loads((out / "demo.json").read_text())
    assert told["accepted"] == [HIDDEN]
    assert told["returns"]["mended"] == outcome.mended.returns.tolist()
    assert told["advantage"]["mean"] == outcome.advantage[0]


@pytest.mark.slow
def test_the_study_judges_each_seed_by_its_own_figures(quick: tuple[Outcome, Path]) -> None:
    outcome, _ = quick
    wrong = replace(outcome.wrong, returns=torch.tensor([10.0, 12.0, 11.0, 13.0]))
    truth = torch.tensor([outcome.truth[name] for name in outcome.mended.names])
    near = truth * (1 + 0.01 * torch.tensor([[-1.0], [0.0], [1.0]]))
    mended = replace(outcome.mended, samples=near, returns=torch.tensor([90.0, 92.0, 91.0, 93.0]))
    better = replace(outcome, wrong=wrong, mended=mended)
    assert tabulate([better]).holds
    assert not tabulate([replace(better, mended=replace(mended, samples=near + 0.05 * truth))]).holds
    even = replace(outcome, wrong=wrong, mended=replace(outcome.mended, returns=wrong.returns + 1.0))
    judged = {row.name: row.holds for row in tabulate([better, replace(even, seed=1)]).rows}
    assert judged["seed 0: difference of the returns"] is True
    assert judged["seed 1: difference of the returns"] is False


def test_seeds_are_different_rigs_and_the_problem_file_tells_no_truth(tmp_path: Path) -> None:
    assert hidden_truth(0) != hidden_truth(1)
    made = measure(1, Protocol(fit=2, held=1, seconds=0.5))
    path = write_problem(made, tmp_path)
    assert "delay" not in path.read_text()
    problem = load_problem(path)
    assert problem.holdout == ("held1",)
    torch.testing.assert_close(problem.measurement.data["signal"][..., 0], made.angle, rtol=0, atol=1e-8)


@pytest.mark.slow
def test_the_mended_models_belief_is_narrow_and_near_the_truth(quick: tuple[Outcome, Path]) -> None:
    """Both: a wide belief holds the truth, and a narrow one may be elsewhere."""
    outcome, _ = quick
    samples = outcome.mended.samples
    truth = samples.new_tensor([outcome.truth[name] for name in outcome.mended.names])
    assert bool(((samples.mean(0) / truth - 1).abs() < 0.01).all())
    assert bool((samples.std(0) / truth < 0.002).all())


@pytest.mark.long
def test_the_mended_models_policy_is_better_by_two_standard_errors(tmp_path: Path) -> None:
    outcome = run(0, tmp_path, Budget())
    difference, se = outcome.advantage
    assert difference > 2 * se
    assert outcome.farthest < 4
