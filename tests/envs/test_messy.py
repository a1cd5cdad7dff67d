"""Messy machines: what dominates and what does not, habits of runs and motors, files of a long run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from envs.rigs import RIGS, messy_case, write_case
from envs.rigs.drive import Drive
from envs.rigs.messy import messy_machine
from envs.rigs.recording import Habits, record
from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput

unchecked = pytest.mark.usefixtures("without_shape_checks")


@pytest.mark.parametrize("name", RIGS)
def test_one_or_two_dominate_and_six_to_ten_small_ones_of_other_laws_lie_beside_them(name: str) -> None:
    plain = RIGS[name]
    two, alone = 0, 0
    for seed in range(30):
        mess, _ = messy_machine(name, seed)
        assert 1 <= len(mess.keys) <= 2
        assert 6 <= len(mess.small) <= 10
        small = [key for group in mess.small for key in group]
        laws = {plain.laws.get(key, key) for key in mess.keys}
        assert not (laws | set(plain.partners(tuple(laws)))) & {plain.laws.get(key, key) for key in small}
        assert len(set(small)) == len(small)
        mujoco.MjModel.from_xml_string(mess.xml)
        assert (mess.xml != plain.xml) == any("@" not in key for key in (*mess.keys, *small))
        floors = mess.rig.protocol.floor / plain.protocol.floor
        assert len(plain.joints) == 1 or floors.max() > 10 * floors.min()
        two += len(mess.keys) == 2
        alone += mess.rig.protocol.held == 0
    assert 0 < two < 25
    assert (0 < alone < 20) == (name != "thrown_ball")


@pytest.mark.parametrize(("arguments", "problem"), [(("crane", 0), "rig 'crane'"), (("swing", -1), "-1")])
def test_unknown_machines_are_refused(arguments: tuple[str, int], problem: str) -> None:
    with pytest.raises(BadInput, match=problem):
        messy_case(*arguments)


def test_a_motor_may_give_less_one_way() -> None:
    rig = RIGS["swing"]
    drive = Drive(rig.actuators, {"direction_gain@motor.gain": 0.1}, 2, 1, 1e-3)
    np.testing.assert_allclose(drive.shaped(np.array([[2.0], [-2.0]])), [[2.2], [-1.8]])


@pytest.mark.long
@unchecked
def test_zeros_differ_by_run_and_the_end_of_a_run_goes_farther() -> None:
    rig = RIGS["swing"]
    rig = replace(rig, protocol=replace(rig.protocol, sd=(0.0,), resolution=(1e-9,)))
    habits = Habits(np.array([[0.1], [-0.2]]), np.array([[0.5, 0.5], [0.5, 1.0]]))
    made, usual = (
        record(rig, rig.nominal, np.random.default_rng(2), runs=2, seconds=3.0, habits=one) for one in (habits, None)
    )
    np.testing.assert_allclose(made.reading - made.q, np.broadcast_to(habits.zeros, made.q.shape), rtol=0, atol=2e-9)
    early, late = made.time < 2.0, made.time > 2.5
    np.testing.assert_allclose(made.command[early], 0.5 * usual.command[early], rtol=0, atol=2e-6)
    np.testing.assert_allclose(made.command[late, 0], 0.5 * usual.command[late, 0], rtol=0, atol=2e-6)
    np.testing.assert_allclose(made.command[late, 1], usual.command[late, 1], rtol=0, atol=2e-6)


@pytest.mark.long
@unchecked
@pytest.mark.parametrize("name", ["swing", "slide_drive", "thrown_ball"])
def test_messy_cases_are_problems_and_a_long_run_holds_out_its_end(name: str, tmp_path: Path) -> None:
    seeds = {messy_machine(name, seed)[0].rig.protocol.held == 0: seed for seed in range(20)}
    for alone, seed in seeds.items():
        made = messy_case(name, seed)
        assert all(np.isfinite(column).all() for table in made.columns.values() for column in table.values())
        problem = load_problem(write_case(made, tmp_path))
        assert (problem.holdout is None) == alone == (len(made.columns) == 1)
        assert set(problem.simulator.parameters) == set(made.parameters)
