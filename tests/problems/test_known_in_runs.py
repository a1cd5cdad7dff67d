"""``[runs]`` of a problem file: what is known in some runs, zero among it, and what cannot be known."""

from __future__ import annotations

import pytest

from onlinebayes.problems import load_problem
from onlinebayes.runs import BadInput
from tests.problems.conftest import PROBLEM

FREE = PROBLEM.replace('"body.carriage.mass" = [1.0, 10.0]\n', "")


def known(folder, first: str, second: str, text: str = FREE):
    """The problem whose two runs know a line each."""
    (folder / "carriage.toml").write_text(f"{text}[runs.first]\n{first}\n[runs.second]\n{second}\n")
    return folder / "carriage.toml"


def test_runs_may_know_masses_far_apart(folder):
    """0.5 and 1.5 kg once made bounds from -1 kg, and the model's own 3 kg is beside nothing: no bounds were given."""
    path = known(folder, '"body.carriage.mass" = 0.5', '"body.carriage.mass" = 1.5')
    notes: list[str] = []
    problem = load_problem(path, note=notes.append)
    assert problem.scope is not None
    assert [problem.scope.constants(run)["body.carriage.mass"] for run in ("first", "second")] == [0.5, 1.5]
    assert problem.simulator.parameters["body.carriage.mass"].low == 0
    assert problem.simulator.parameters["body.carriage.mass"].unit == "kg"
    assert not notes


def test_a_known_zero(folder):
    line = '"joint.carriage.frictionloss" = 0.0'
    scope = load_problem(known(folder, line, line)).scope
    assert scope is not None
    assert [scope.constants(run) for run in ("first", "second")] == [{"joint.carriage.frictionloss": 0.0}] * 2


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('"body.carriage.mass" = -2', r'runs\.second\."body\.carriage\.mass": .* a mass of -2 kg cannot be; give 0'),
        ('"dry_friction@carriage.friction" = 1', r"@carriage has no parameter 'friction'; nearest: frictionloss"),
        (
            '"dry_friction@carriage.frictionloss" = -5',
            r'runs\.second\."dry_friction@carriage\.frictionloss": -5 cannot be known: .* never negative',
        ),
        ('"actuator_gain@motor.gain" = -1', "-1 cannot be known: .* the actuator is dead"),
        ('"dry_friction@carrage.frictionloss" = 1', "no joint 'carrage'"),
        ('"body.carriage.mas" = 2', r'runs\.second\."body\.carriage\.mas": .*no field \'mas\''),
    ],
)
def test_what_cannot_be_known_names_its_key(folder, line, message):
    with pytest.raises(BadInput, match=message):
        load_problem(known(folder, '"body.carriage.mass" = 2', line))


def test_a_parameter_that_is_fitted_elsewhere_is_checked_in_its_run(folder):
    with pytest.raises(BadInput, match=r'runs\.second\."body\.carriage\.mass": .* a mass of -2 kg'):
        load_problem(known(folder, '"body.carriage.mass" = 2', '"body.carriage.mass" = -2', PROBLEM))


def test_an_effects_constant_may_be_zero_or_large(folder):
    path = known(
        folder, '"dry_friction@carriage.frictionloss" = 0', '"dry_friction@carriage.frictionloss" = 1e30', PROBLEM
    )
    scope = load_problem(path).scope
    assert scope is not None
    assert scope.constants("second") == {"dry_friction@carriage.frictionloss": 1e30}
