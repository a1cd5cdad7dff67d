"""The machines that hide an effect move as physics says, and the study's table says what its jobs found."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from tensordict import TensorDict

from envs.cartpole import CartPole
from envs.pendulum import Pendulum
from recipes import cartpole, pendulum
from recipes.hidden_effect import Settings, main
from recipes.hidden_machine import CARTPOLE, PENDULUM, Hidden, Machine
from recipes.studies.hidden_effect import EFFECTS, EXCITED, KINDS, NAMING, SEEDS, Job, Study, jobs_of, tabled

TRUTH = torch.tensor([[0.6, 0.4]], dtype=torch.float64)


def moved(machine, commands, q, v=None):
    """States along a list of commands."""
    start = torch.tensor([q], dtype=torch.float64)
    rate = torch.zeros_like(start) if v is None else torch.tensor([v], dtype=torch.float64)
    machine.reset(TRUTH, TensorDict({"qpos": start, "qvel": rate}, (1,)))
    inputs = [TensorDict({"command": torch.tensor([[float(u)]])}, (1,)) for u in commands]
    return torch.stack([machine.step(one) for one in inputs])[:, 0]


class FinePendulum(Pendulum):
    timestep = 0.0005


class FineCartPole(CartPole):
    timestep = 0.0005


@pytest.mark.parametrize(
    ("equations", "model", "space", "dt", "q"),
    [
        (PENDULUM, FinePendulum, pendulum.SPACE, 0.05, [2.0]),
        (CARTPOLE, FineCartPole, cartpole.SPACE, 0.02, [0.0, 0.1]),
    ],
)
def test_a_machine_that_hides_nothing_moves_as_its_model_in_fine_steps(equations, model, space, dt, q) -> None:
    commands = [1.0, -1.0, -0.5, 1.0, 1.0, 0.0, -1.0, 0.5] * 2
    real = moved(Machine(equations, space, Hidden(), dt), commands, q)
    simulated = moved(model(space, dt=dt), commands, q)
    torch.testing.assert_close(real["qpos"], simulated["qpos"], atol=2e-3, rtol=0)
    torch.testing.assert_close(real["qvel"], simulated["qvel"], atol=1e-2, rtol=0)


def test_dry_friction_holds_what_is_too_light_and_brakes_the_rest() -> None:
    """m g l / 2 sin(q) is 1.2 sin(q) N m: at 0.1 rad less than F = 0.2. Energy falls by F times the way."""
    machine = Machine(PENDULUM, pendulum.SPACE, Hidden(friction=0.2), 0.05)
    still = moved(machine, [0.0] * 20, [0.1])
    assert bool((still["qvel"] == 0).all())
    assert bool((still["qpos"] == 0.1).all())
    falling = moved(machine, [0.0] * 10, [2.0])
    length, mass = TRUTH[0]
    energy = mass * length**2 / 6 * falling["qvel"] ** 2 + 5 * mass * length * torch.cos(falling["qpos"])
    way = (falling["qpos"] - 2.0).abs()
    begun = 5 * mass * length * torch.cos(torch.tensor(2.0, dtype=torch.float64))
    turned = bool((falling["qvel"] < 0).any())
    assert not turned
    torch.testing.assert_close(energy, begun - 0.2 * way, atol=1e-3, rtol=0)


def test_a_late_command_acts_as_the_command_before() -> None:
    commands = [2.0, -1.0, 0.5, 1.5, -2.0]
    late = moved(Machine(PENDULUM, pendulum.SPACE, Hidden(delay=0.1), 0.05), [*commands, 0.0, 0.0], [2.0])
    timely = moved(Machine(PENDULUM, pendulum.SPACE, Hidden(), 0.05), [0.0, 0.0, *commands], [2.0])
    torch.testing.assert_close(late["qpos"], timely["qpos"])


def test_machines_that_are_reset_apart_do_not_disturb_each_other() -> None:
    machine = Machine(PENDULUM, pendulum.SPACE, Hidden(delay=0.1), 0.05, worlds=2)
    start = TensorDict({"qpos": torch.tensor([[1.0], [2.0]]), "qvel": torch.zeros(2, 1)}, (2,))
    machine.reset(TRUTH.expand(2, -1), start)
    machine.step(TensorDict({"command": torch.ones(2, 1)}, (2,)))
    before = machine.state
    after = machine.reset(TRUTH.expand(2, -1), start, torch.tensor([True, False]))
    assert float(after["qpos"][0, 0]) == 1.0
    assert bool((after["late"][0] == 0).all())
    assert torch.equal(after[1]["qpos"], before[1]["qpos"])
    assert torch.equal(after[1]["late"], before[1]["late"])


def test_the_table_says_what_was_named_and_what_it_is_worth(tmp_path: Path) -> None:
    study = Study(systems=("pendulum",), seeds=(0, 1))
    found = {}
    for seed in study.seeds:
        said = [[], ["dry_friction@hinge"]] if seed else [["backlash@hinge"], ["dry_friction@hinge"]]
        hidden = ["dry_friction@hinge"]
        found[Job("pendulum", "friction", NAMING, seed)] = {"hidden": hidden, "said": said, "seconds": [1.0, 3.0]}
        found[Job("pendulum", "nothing", NAMING, seed)] = {"hidden": [], "said": [[], hidden * seed], "seconds": [2.0]}
        for kind, value in zip(KINDS, (-110.0, -400.0, -100.0), strict=True):
            found[Job("pendulum", "friction", kind, seed)] = {"before": -1100.0, "return": value}
    table = tabled(found, study)
    rows = {row.name: row for row in table.rows}
    assert "(a part)" in table.command
    assert (rows["pendulum, friction: named"].value, rows["pendulum, friction: named"].holds) == (2, None), (
        "two seeds are not ten"
    )
    assert rows["pendulum, nothing hidden: something added"].holds is False
    assert rows["pendulum, friction: share with criticism"].value == pytest.approx(0.99)
    assert rows["pendulum, friction: share without"].value == pytest.approx(0.7)
    assert rows["pendulum, friction: share without"].holds is None
    assert not any("delay" in name for name in rows)
    assert not table.holds


def test_all_jobs_are_as_many_as_the_issue_asks() -> None:
    jobs = jobs_of(Study())
    assert len(set(jobs)) == len(jobs)
    assert sum(job.effect == "nothing" and job.kind == NAMING for job in jobs) == 20
    assert {(job.system, job.effect) for job in jobs if job.kind == EXCITED} == {
        ("cartpole", "friction"),
        ("cartpole", "nothing"),
    }
    assert sum(job.kind == NAMING for job in jobs) == 2 * 3 * len(SEEDS)
    assert sum(job.kind in KINDS for job in jobs) == 2 * len(EFFECTS) * 3 * len(SEEDS)


@pytest.mark.slow
@pytest.mark.usefixtures("without_shape_checks")
def test_a_short_run_names_the_friction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """By a fixed seed."""
    assert main(Settings(short=True, out=str(tmp_path), steps=2)) == 0
    assert "found: dry_friction@hinge" in capsys.readouterr().out
    (folder,) = tmp_path.iterdir()
    assert {"run.rrd", "run.html", "log.csv", "finished"} <= {path.name for path in folder.iterdir()}
