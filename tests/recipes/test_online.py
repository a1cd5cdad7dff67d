from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch
from torchrl.data import TensorSpec

from onlinebayes.inference import BoxUniform
from onlinebayes.objectives import ppo
from onlinebayes.runs import BadInput
from onlinebayes.trainers import OnlineState, Schedule
from onlinebayes.transforms import ParameterRandomization
from recipes.cartpole import PROBLEM as CARTPOLE
from recipes.pendulum import PROBLEM as PENDULUM
from recipes.studies import online
from recipes.studies.online import NOISES, SEEDS, Outcome, Settings, truth_of
from recipes.studies.online_problem import Point, learner, score, worlds
from recipes.studies.online_problem import online as run_online


@pytest.mark.parametrize("problem", [CARTPOLE, PENDULUM])
def test_the_state_behind_an_observation(problem):
    env = worlds(problem, 16, ParameterRandomization(BoxUniform(problem.space)), 0.0, 0)
    observation = env.rollout(5)["observation"][:, -1]
    again = problem.task.observe(problem.state(observation))
    torch.testing.assert_close(again, observation, atol=2e-6, rtol=0)


def test_the_truths_are_the_published_points():
    points = [truth_of(CARTPOLE, seed).tolist() for seed in SEEDS]
    unit = [[0.5, 0.5], [0.75, 0.25], [0.25, 0.75], [0.375, 0.375], [0.875, 0.875]]
    assert points[0] == [0.5, 0.1]
    assert truth_of(PENDULUM, 0).tolist() == [1.0, 1.0]
    for point, u in zip(points[1:], unit, strict=True):
        assert point == pytest.approx([0.1 + 0.9 * x for x in u])


def test_noise_is_that_share_of_the_range_and_consistent_over_resets():
    drawn = ParameterRandomization(BoxUniform(CARTPOLE.space))
    quiet, loud = (worlds(CARTPOLE, 256, drawn.clone(), noise, 3).reset()["observation"] for noise in (0.0, 0.01))
    # 256 draws: the estimate of sd has a relative standard error of 4.4 %, 5 of them are allowed.
    spread = (loud - quiet).std(0) / torch.tensor(CARTPOLE.sensor_range)
    torch.testing.assert_close(spread, torch.full((4,), 0.01), rtol=0.22, atol=0)
    data = worlds(CARTPOLE, 32, drawn.clone(), 0.01, 3).rollout(60, break_when_any_done=False)
    going_on = ~data["next", "done"][:, :-1, 0]
    assert going_on.float().mean() < 1, "some worlds reset"
    seen, acted_on = data["next", "observation"][:, :-1][going_on], data["observation"][:, 1:][going_on]
    assert torch.equal(seen, acted_on)


def outcome(kind: str, seed: int, noise: float) -> Outcome:
    return Outcome(kind, seed, noise, (1.0, 8.0 + seed) if kind == "online" else (), 480.0 + seed, 470.0, 1000)


def test_the_table_has_every_seed_and_judges_medians():
    outcomes = [outcome("online", seed, noise) for seed in SEEDS for noise in NOISES]
    outcomes += [outcome(kind, seed, 0.0) for seed in SEEDS for kind in ("oracle", "prior")]
    table = online.tabulate(CARTPOLE, outcomes)
    assert table.holds
    assert sum("log density of the truth" in row.name for row in table.rows) == len(SEEDS) * len(NOISES)
    judged = {row.name: row for row in table.rows if row.goal}
    assert judged["no noise, median of seeds 1-5: log density"].value == 11.0
    worse = [replace(o, log_density=(1.0, 8.9)) if o.kind == "online" else o for o in outcomes]
    assert not online.tabulate(CARTPOLE, worse).holds
    json.loads(table.to_json())


def test_a_study_goes_on_from_its_finished_runs(tmp_path, monkeypatch, capsys):
    asked = []

    def in_processes(problem, jobs, processes):
        for number, job in enumerate(jobs):
            if len(asked) == 5 and number == 5:
                raise KeyboardInterrupt
            asked.append(job)
            yield outcome(*job)

    monkeypatch.setattr(online, "_in_processes", in_processes)
    settings = Settings(study=True, out=str(tmp_path / "out"), results=str(tmp_path / "results"))
    assert online.study(CARTPOLE, settings) == 130
    assert "5 of 24 runs are kept" in capsys.readouterr().out
    assert not (tmp_path / "results").exists()
    assert online.study(CARTPOLE, settings) == 0
    assert len(asked) == len(set(asked)) == 24
    assert (tmp_path / "results" / "cartpole.json").exists()


def test_a_run_cut_short_is_no_result(monkeypatch):
    def stopped(problem, truth, noise, seed, on_step):
        return OnlineState(BoxUniform(problem.space), interrupted=True), learner(problem)

    monkeypatch.setattr(online, "online", stopped)
    with pytest.raises(KeyboardInterrupt):
        online.run(CARTPOLE, "online", 1, 0.0)


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(BadInput, match="noise"):
        online.main(CARTPOLE, Settings(noise=1.5))


@pytest.mark.slow
def test_cartpole_at_a_fraction_of_the_effort():
    """Three outer steps: the posterior beats the thesis's figure for thirty, the policy balances."""

    def objective(observation: TensorSpec, action: TensorSpec):
        return ppo(observation, action)

    problem = replace(CARTPOLE, objective=objective, schedule=Schedule(3, 12, 50), simulations=400)
    truth, densities = truth_of(problem, 1), []
    _, learnt = run_online(
        problem, truth, 0.0, 1, lambda state, _: densities.append(float(state.posterior.log_prob(truth)))
    )
    assert densities[-1] > 4.66
    drawn = ParameterRandomization(Point(truth))
    assert score(problem, learnt.policy, truth, 0.0) > 300
    assert score(problem, learner(problem).policy, truth, 0.0) < 100
    assert drawn.distribution.sample((2,)).shape == (2, 2)
