"""A law that all joints lack enters at all of them at once; a log that another engine wrote is run in its steps."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism.hypotheses.additions import AddedEffect, FreedNumber
from onlinebayes.criticism.hypotheses.same_law_at_all_places import law_of
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import Armature, DryFriction, Scales, ViscousFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import NOISE, TRUTH, commands, explain, measure, model

CARTS = """
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody>{}</worldbody><actuator>{}</actuator></mujoco>"""
CART = """<body name="{0}"><joint name="{0}" type="slide" axis="1 0 0"/>
  <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/></body>"""
NAMES, LACKING = ("left", "middle", "right"), 1.5
MASSES = ParameterSpace({f"body.{name}.mass": Parameter(0.5, 8.0, "kg") for name in NAMES})


def carts() -> MujocoSimulator:
    motors = "".join(f'<motor name="{name}" joint="{name}"/>' for name in NAMES)
    return MujocoSimulator(CARTS.format("".join(map(CART.format, NAMES)), motors), MASSES, threads=1)


def damped(runs: int = 6, rows: int = 301, dry: float = 0.0) -> Measurement:
    """Three carts that rub alike; the left one rubs dry too, with a force of ``dry`` (N)."""
    simulator = carts()
    for name in NAMES:
        simulator = simulator.with_effect(ViscousFriction(name, Parameter(0.0, 5.0, "N s/m")))
    simulator = simulator.with_effect(DryFriction("left", Parameter(0.0, 5.0, "N")))
    command = torch.cat([commands(runs, rows, 0.01, seed) for seed in range(3)], dim=2)
    theta = torch.tensor([2.0] * 3 + [LACKING] * 3 + [dry], dtype=torch.float64).expand(runs, -1)
    rest = torch.zeros(runs, 3, dtype=torch.float64)
    times = 0.01 * torch.arange(rows, dtype=torch.float64)
    inputs = TensorDict({"command": command[:, :-1]}, batch_size=(runs, rows - 1))
    state = TensorDict({"qpos": rest, "qvel": rest}, batch_size=(runs,))
    path = torch.cat([rest[:, None], simulator.rollout(theta, state, inputs, times[1:])["qpos"]], dim=1)
    path = path + NOISE * torch.randn(path.shape, dtype=path.dtype)
    table = {
        f"run{r}": {"time": times.numpy()}
        | {f"ctrl.{name}": command[r, :, j].numpy() for j, name in enumerate(NAMES)}
        | {f"qpos.{name}": path[r, :, j].numpy() for j, name in enumerate(NAMES)}
        for r in range(runs)
    }
    signals = [Signal(f"qpos.{name}", "m", sd=NOISE) for name in NAMES]
    return Measurement.from_runs(table, signals=signals, commands=list(NAMES))


@pytest.mark.slow
def test_what_all_joints_lack_is_named_at_all_of_them_in_one_round() -> None:
    found = explain(carts(), damped(), holdout=["run5"], candidates=["viscous_friction", "dry_friction"])
    keys = {f"viscous_friction@{name}" for name in NAMES}
    assert set(found.found.hypothesis.keys) == keys
    assert [found.found.values[f"{key}.damping"] for key in keys] == pytest.approx([LACKING] * 3, rel=0.01)
    first, *others = found.rounds
    assert all(one.screened is first.screened for one in others[:2])  # nothing was screened in between


@pytest.mark.slow
def test_what_one_joint_lacks_beside_a_law_at_all_of_them_is_named_too() -> None:
    candidates = ["viscous_friction", "dry_friction"]
    found = explain(carts(), damped(dry=0.6), holdout=["run5"], candidates=candidates)
    keys = {f"viscous_friction@{name}" for name in NAMES} | {"dry_friction@left"}
    assert set(found.found.hypothesis.keys) == keys


def test_a_law_is_known_wherever_it_is() -> None:
    friction = DryFriction("left", Parameter(0.0, 1.0, "N"))
    assert law_of(AddedEffect(friction)) == "dry_friction"
    assert law_of(AddedEffect(friction, per_run=True)) is None
    freed = [FreedNumber(f"joint.{name}.armature", Parameter(0.0, 1.0)) for name in NAMES]
    assert {law_of(one) for one in freed} == {"joint.armature"}


def test_sizes_of_a_number_are_counted_from_the_models_own() -> None:
    bounds = Parameter(0.0, 4.2, "N s/m")
    addition = FreedNumber("joint.rail.damping", bounds)
    simulator = addition.joined(model(ParameterSpace({"body.cart.mass": Parameter(0.5, 8.0, "kg")})), ())
    (start,) = addition.starts(simulator, {})
    ends = sorted(start.neutral + start.reach * size for size in (start.low, start.high))
    assert ends == pytest.approx([bounds.low, bounds.high])


def test_a_rotor_may_have_many_times_the_inertia_of_its_limb() -> None:
    armature = Armature.scaled("left", Scales(1.0, 1.0, 1.0, 1.0, inertia=0.1))
    assert armature.parameters["armature"].high >= 10 * 0.1
    assert all(0 < start["armature"] < armature.parameters["armature"].high for start in armature.starts)


@pytest.mark.slow
def test_a_log_in_steps_of_first_order_is_judged_in_these() -> None:
    found = explain(model(), measure(runs=10, simulator=model().with_first_order()), holdout=["run8", "run9"])
    assert found.found.hypothesis.keys == ()
    assert found.evaluator.original_integrator
    assert found.evaluator.discretisation.values.method == "first_order"
    assert [found.found.values[name] for name in model().parameters] == pytest.approx(TRUTH, rel=0.01)
