"""Forces of effects along a replay: their own law, at the replay's own speeds."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.identification.replaying.forces import effect_forces
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.results import FittedModel, ReplayedRun
from onlinebayes.identification.scope import Scope
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import (
    ActuatorGain,
    ConstantLoad,
    DryFriction,
    Effect,
    JointStiffness,
    LoadDependentFriction,
    QuadraticDrag,
)
from tests.report.synthetic import SIGNAL, Unmoved


def space(effect: Effect) -> ParameterSpace:
    """The effect's parameters under the names that a simulator gives them."""
    return ParameterSpace({f"{effect.key}.{name}": effect.parameters[name] for name in effect.parameters})


def test_each_law_is_its_own() -> None:
    effects = (
        DryFriction("carriage", Parameter(0, 100, "N")),
        ConstantLoad("carriage", Parameter(-50, 50, "N")),
        QuadraticDrag("carriage", Parameter(0, 10, "N s2/m2")),
        JointStiffness("carriage", Parameter(0, 100, "N/m"), Parameter(-1, 1, "m")),
        ActuatorGain("motor", Parameter(-0.5, 0.5)),
        LoadDependentFriction("carriage", Parameter(0, 1)),  # a replay does not hold the load
    )
    sizes = {"dry_friction@carriage.frictionloss": 20.0, "constant_load@carriage.load": 3.0}
    sizes |= {"quadratic_drag@carriage.drag": 2.0, "joint_stiffness@carriage.stiffness": 5.0}
    simulator = Unmoved()
    for effect in effects:
        simulator.parameters = simulator.parameters | space(effect)
    simulator.effects = effects
    theta = torch.tensor([sizes.get(name, 0.0) for name in simulator.parameters], dtype=torch.float64)
    time = torch.arange(200, dtype=torch.float64) / 100
    q = torch.where(time < 1, time, 2 - time)[:, None]  # there and back at 1 m/s
    window = (time >= 1).int()
    run = ReplayedRun("r", True, time, q, q, q, q, window)
    model = FittedModel(simulator, theta, torch.eye(len(theta)), {}, (), (run,))
    found = {force.effect: force for force in effect_forces(model, run, (SIGNAL,))}
    assert list(found) == [effect.key for effect in effects[:4]]
    forth, back = time < 1, time >= 1
    friction = found["dry_friction@carriage"].value
    assert friction[forth] == pytest.approx(-20.0)
    assert friction[back] == pytest.approx(20.0)
    assert found["constant_load@carriage"].value == pytest.approx(3.0)
    assert found["quadratic_drag@carriage"].value[forth] == pytest.approx(-2.0)
    assert found["joint_stiffness@carriage"].value == pytest.approx(-5.0 * q[:, 0])


def test_a_joint_at_rest_has_no_known_friction() -> None:
    simulator = Unmoved()
    effect = DryFriction("carriage", Parameter(0, 100, "N"))
    simulator.parameters, simulator.effects = space(effect), (effect,)
    still = torch.zeros(10, 1, dtype=torch.float64)
    run = ReplayedRun("r", True, torch.arange(10.0).double(), still, still, still, still, torch.zeros(10).int())
    model = FittedModel(simulator, torch.tensor([20.0]).double(), torch.eye(1), {}, (), (run,))
    (force,) = effect_forces(model, run, (SIGNAL,))
    assert force.value == pytest.approx(0.0)


def test_a_run_feels_its_own_size() -> None:
    simulator = Unmoved()
    effect = ConstantLoad("carriage", Parameter(-50, 50, "N"))
    simulator.parameters, simulator.effects = space(effect), (effect,)
    scoped = ScopedSimulator(simulator, Scope((effect.key,)), ("light", "heavy"))
    rows = torch.zeros(5, 1, dtype=torch.float64)
    theta = torch.tensor([3.0, 7.0], dtype=torch.float64)
    for name, load in (("light", 3.0), ("heavy", 7.0), ("new", 5.0)):
        run = ReplayedRun(name, True, torch.arange(5.0).double(), rows, rows, rows, rows, torch.zeros(5).int())
        (force,) = effect_forces(FittedModel(scoped, theta, torch.eye(2), {}, (), (run,)), run, (SIGNAL,))
        assert force.value == pytest.approx(load)
