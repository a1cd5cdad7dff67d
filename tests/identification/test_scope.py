"""Parameters that differ between runs: the map, what is recovered, and that each run is judged by its other half."""

import dataclasses
import re

import pytest
import torch

from onlinebayes.criticism import Scope, compare, refine
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.heldout import replay_runs
from onlinebayes.identification.fitting.per_run_values import held_out_model
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.replaying.charted import ChartedSimulator
from onlinebayes.identification.replaying.replay import replay
from onlinebayes.identification.replaying.scoped import (
    ScopedSimulator,
    effect_entries,
    scoped,
)
from onlinebayes.measurements import Measurement, concatenate
from onlinebayes.parameters import Parameter
from onlinebayes.runs import BadInput
from onlinebayes.simulators.base import Simulator
from onlinebayes.simulators.effects import ConstantLoad, DryFriction, SensorBias
from onlinebayes.simulators.identifiable import Identifiable
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_simulator
from tests.criticism.rigs import FREE, SLIDE, TRUTH, measure, model

LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
MASS, DAMPING = FREE.names
PER_RUN = Scope(per_run=(MASS,))
MASSES = (2.0, 2.4, 2.8) * 3


def weighed(masses: tuple[float, ...], loads: tuple[float, ...] = (), seconds: float = 3.0) -> Measurement:
    """A run for each mass [kg], with a load [N] in it where there are some."""
    parts = []
    for k, mass in enumerate(masses):
        effects = {LOAD: (loads[k],)} if loads else {}
        one = measure(effects, runs=1, seconds=seconds, seed=10 * k, truth=(mass, TRUTH[1]))
        parts.append(dataclasses.replace(one, runs=(f"run{k}",)))
    return concatenate(parts)


@pytest.fixture(scope="module")
def loaded() -> Measurement:
    """Nine runs, each with a mass of its own."""
    return weighed(MASSES)


def test_the_map(loaded) -> None:
    simulator = ScopedSimulator(model(), Scope((MASS,), {"run1": {MASS: 3.0}}), loaded.runs[:3])
    assert simulator.parameters.names == (f"{MASS}[run run0]", f"{MASS}[run run2]", DAMPING)
    phi = torch.tensor([2.0, 4.0, 1.5], dtype=torch.float64)
    rows = {"run0": (2.0, 1.5), "run1": (3.0, 1.5), "run2": (4.0, 1.5), "run2 (last third)": (4.0, 1.5)}
    rows["another"] = (3.0, 1.5)  # the mean of the runs
    for run, theta in rows.items():
        A, c = simulator.affine(run)
        assert (A @ phi + c).tolist() == pytest.approx(theta)
    assert simulator.typical(phi).tolist() == pytest.approx((3.0, 1.5))
    assert simulator.nominal.tolist() == [2.0, 2.0, 1.0]


@pytest.mark.parametrize("around", [ScopedSimulator, ChartedSimulator])
def test_no_hook_of_a_simulator_stays_behind(around: type[Identifiable]) -> None:
    """What a simulator may override is passed through, or the base class's answer would hide the physics' own."""
    abilities = Identifiable.__mro__[: Identifiable.__mro__.index(Simulator)]
    hooks = {name for ability in abilities for name in vars(ability) if not name.startswith("_")}
    assert {"with_gravity_compensation", "actuator_forces", "read", "with_timestep"} <= hooks
    passed = {name for base in around.__mro__[: around.__mro__.index(Identifiable)] for name in vars(base)}
    assert hooks - passed == set()


def test_the_typical_world_is_a_simulator(loaded) -> None:
    physics = MujocoSimulator(SLIDE, FREE, worlds=3, threads=1)
    check_simulator(ScopedSimulator(physics, PER_RUN, loaded.runs[:2]))


def test_known_everywhere_is_not_fitted_and_unknown_is_the_models_own() -> None:
    simulator = ScopedSimulator(model(), Scope((), {"a": {MASS: 3.0}}, unfitted=(MASS,)), ("a", "b"))
    assert simulator.parameters.names == (DAMPING,)
    assert [float(simulator.affine(run)[1][0]) for run in ("a", "b")] == [3.0, 2.0]


def test_no_scope_is_the_simulator_itself(loaded) -> None:
    simulator = model()
    assert scoped(simulator, None, loaded, loaded.runs) is simulator
    assert scoped(simulator, Scope(), loaded, loaded.runs) is simulator


def test_every_window_is_replayed_with_its_own_theta(loaded) -> None:
    """The scoped replay is, bit for bit, the plain one of each run alone."""
    simulator = ScopedSimulator(model(), PER_RUN, loaded.runs)
    windows = make_windows(simulator, loaded, 1.0)
    phi = torch.tensor([*MASSES, TRUTH[1]], dtype=torch.float64)
    together, _ = replay(simulator, windows, phi[None], windows.start[None])
    for r, mass in enumerate(MASSES):
        mine = windows.select((windows.run == r).nonzero()[:, 0])
        theta = phi.new_tensor([[mass, TRUTH[1]]])
        alone, _ = replay(model(), mine, theta, mine.start[None])
        assert torch.equal(together[:, windows.run == r], alone)


def test_sensors_of_every_run_show_what_its_own_theta_says(loaded) -> None:
    bias = SensorBias("qpos.rail", Parameter(-1.0, 1.0, "m"))
    physics = model().with_effect(bias)
    simulator = ScopedSimulator(physics, Scope((bias.key,)), loaded.runs)
    windows = make_windows(physics, loaded, 1.0)
    own = torch.linspace(-0.5, 0.5, len(loaded.runs), dtype=torch.float64)
    phi = torch.cat([torch.tensor(TRUTH).double(), own])
    shown, _ = replay(simulator, windows, phi[None], windows.start[None])
    for r in range(len(loaded.runs)):
        mine = windows.select((windows.run == r).nonzero()[:, 0])
        alone, _ = replay(physics, mine, torch.cat([phi[:2], own[r : r + 1]])[None], mine.start[None])
        torch.testing.assert_close(shown[:, windows.run == r], alone, rtol=0, atol=1e-12)
    (first, *_) = replay_runs(simulator, windows, phi, held_out=False)
    torch.testing.assert_close(first.simulated, shown[0, windows.run == 0].flatten(0, 1)[: len(first.time)])


def test_own_sensitivities_are_those_of_the_shared_parameter_in_their_windows(loaded) -> None:
    windows = make_windows(model(), loaded, 1.0)
    theta = torch.tensor([2.4, TRUTH[1]], dtype=torch.float64)
    shared = linearise(model(), windows, theta, windows.start)
    simulator = ScopedSimulator(model(), PER_RUN, loaded.runs)
    own = linearise(simulator, windows, torch.cat([theta[:1].expand(9), theta[1:]]), windows.start)
    assert torch.equal(own.residual, shared.residual)
    assert torch.allclose(own.by_theta[..., :9].sum(-1), shared.by_theta[..., 0], rtol=1e-12)
    outside = windows.run[:, None] != torch.arange(9)
    assert not bool(own.by_theta.movedim(-1, 1)[:, :9][outside].any())


@pytest.mark.slow
def test_masses_of_the_runs_are_recovered(loaded) -> None:
    result = compare(model(), loaded, scope=PER_RUN)
    assert list(result.parameters) == [*(f"{MASS}[run run{k}]" for k in range(6)), DAMPING]
    for k, mass in enumerate(MASSES[:6]):
        estimate = result.parameters[f"{MASS}[run run{k}]"]
        assert abs(estimate.mean - mass) < max(4 * estimate.sd, 2e-3)
        assert 0 < estimate.sd < 0.01
    assert result.remainder.status == "noise"
    # The held-out runs' masses were never fitted with the others: each half lends its own to the other.
    error, floor = result.heldout_error.after["qpos.rail"], result.heldout_error.noise_floor["qpos.rail"]
    assert error < 1.5 * floor
    assert compare(model(), loaded).heldout_error.after["qpos.rail"] > 10 * error


@pytest.mark.slow
def test_runs_of_one_group_have_one_value(loaded) -> None:
    """Each mass is measured in two runs; the third, held out, is judged with what those two say."""
    groups = ("run[036]", "run[147]", "run[258]")
    result = compare(model(), loaded, scope=Scope((MASS,), groups=groups))
    assert list(result.parameters) == [*(f"{MASS}[run {group}]" for group in groups), DAMPING]
    for mass, group in zip(MASSES, groups, strict=False):
        estimate = result.parameters[f"{MASS}[run {group}]"]
        assert abs(estimate.mean - mass) < max(4 * estimate.sd, 2e-3)
    error, floor = result.heldout_error.after["qpos.rail"], result.heldout_error.noise_floor["qpos.rail"]
    assert error < 1.2 * floor


@pytest.mark.slow
def test_a_group_of_its_own_is_no_group(loaded) -> None:
    alone = compare(model(), loaded, scope=PER_RUN)
    grouped = compare(model(), loaded, scope=Scope((MASS,), groups=tuple(loaded.runs)))
    assert torch.equal(alone.final.theta, grouped.final.theta)
    assert torch.equal(alone.final.covariance, grouped.final.covariance)
    assert alone.heldout_error == grouped.heldout_error


def test_a_held_out_run_of_a_group_borrows_nothing(loaded) -> None:
    simulator = ScopedSimulator(model(), Scope((MASS,), groups=("run[036]",)), loaded.runs[:6])
    assert simulator.owners == ("run[036]", "run1", "run2", "run4", "run5")
    assert (simulator.free_in("run6"), simulator.free_in("run7")) == ((), (MASS,))
    A, _ = simulator.affine("run6 (first half)")
    assert A[0].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def test_held_out_halves_are_swapped(loaded) -> None:
    simulator = ScopedSimulator(model(), PER_RUN, loaded.runs[:6])
    windows = make_windows(simulator, loaded.select(["run7", "run8"]), 1.0)
    phi = torch.tensor([*MASSES[:6], TRUTH[1]], dtype=torch.float64)
    other, parts, values = held_out_model(simulator, windows, phi)
    assert isinstance(other, ScopedSimulator)
    assert other.parameters.names == tuple(
        f"{MASS}[run {run} ({half} half)]" for run in ("run7", "run8") for half in ("first", "second")
    )
    assert values.tolist() == pytest.approx([2.4, 2.4, 2.8, 2.8], abs=5e-3)
    assert parts.run.tolist() == [1, 1, 0, 3, 3, 2]
    assert held_out_model(model(), windows, phi)[1] is windows


@pytest.mark.slow
def test_a_load_of_one_size_a_run_is_named_and_sized() -> None:
    loads = (0.3, 0.4, 0.6, 0.5, 0.2, 0.1, 0.4, 0.5, 0.3)
    data = weighed((2.5,) * 9, loads)
    scope = Scope(per_run=("constant_load@rail",))
    result = refine(model(), data, candidates=["constant_load", "dry_friction"], scope=scope)
    assert result.accepted == ("constant_load@rail",)
    for k in range(6):
        estimate = result.parameters[f"constant_load@rail.load[run run{k}]"]
        assert abs(estimate.mean - loads[k]) < max(4 * estimate.sd, 2e-3)
    assert result.heldout_error.after["qpos.rail"] < 1.5 * result.heldout_error.noise_floor["qpos.rail"]
    row = next(c for c in result.candidates if c.effect == "constant_load@rail")
    assert list(row.parameters) == [f"load[run run{k}]" for k in range(6)]


@pytest.mark.slow
def test_two_effects_of_scope_and_constants_together() -> None:
    """Payloads of one size a run, a known load in some runs: both recovered where they are free, used where known."""
    masses, loads = (2.0, 2.6, 2.2, 2.8, 2.4, 2.5, 2.1), (0.5, 0.0) * 3 + (0.5,)
    data = weighed(masses, loads, seconds=2.0)
    simulator = model().with_effect(LOAD).with_effect(FRICTION)
    load = "constant_load@rail.load"
    known = {f"run{k}": {load: loads[k]} for k in range(7)}
    scope = Scope((MASS, FRICTION.key), known)
    result = compare(simulator, data, holdout=["run6"], scope=scope)
    assert load not in result.parameters
    assert [n for n in result.parameters if n.startswith("dry")] == [
        f"dry_friction@rail.frictionloss[run run{k}]" for k in range(6)
    ]
    for k, mass in enumerate(masses[:6]):
        assert result.parameters[f"{MASS}[run run{k}]"].mean == pytest.approx(mass, abs=1e-2)
        assert result.parameters[f"dry_friction@rail.frictionloss[run run{k}]"].mean < 0.05
    assert result.heldout_error.after["qpos.rail"] < 1.5 * result.heldout_error.noise_floor["qpos.rail"]


def test_entries_of_effects_follow_in_order() -> None:
    simulator = ScopedSimulator(model(), Scope((LOAD.key,)), ("a", "b"))
    for effect in (LOAD, FRICTION):
        entries = tuple(effect_entries(simulator, effect))
        grown = simulator.with_effect(effect)
        assert grown.parameters.names == (*simulator.parameters.names, *entries)


@pytest.mark.parametrize(
    ("scope", "message"),
    [
        (Scope(("body.crt.mass",)), "'body.crt.mass' is no parameter of the simulator; nearest: body.cart.mass"),
        (Scope((), {"rnu1": {MASS: 1.0}}), "no run is called 'rnu1'; nearest: run1"),
        (Scope((), {"run1": {"x": 1.0}}), "'x' is no parameter"),
        (Scope((), {"run1": {MASS: 1.0}, "run?": {MASS: 2.0}}), "run 'run1' has two values"),
        (Scope((MASS,), groups=("rum*",)), "no run is called 'rum*'"),
        (Scope((MASS,), groups=("run*", "run1")), "run 'run1' is in the groups 'run*' and 'run1'"),
    ],
)
def test_a_scope_names_what_is_there(loaded, scope, message) -> None:
    with pytest.raises(BadInput, match=re.escape(message)):
        compare(model(), loaded, scope=scope)
