"""A parameter that differs between runs: called that where it does, never where a law is missing or nothing is."""

import dataclasses

import pytest
import torch

from envs.driven_pendulum.rig import DAMPING as HINGE
from envs.driven_pendulum.rig import MASS as BOB
from envs.driven_pendulum.rig import MODEL, NOMINAL
from envs.driven_pendulum.sets import Protocol, record
from onlinebayes.criticism import Selection, refine
from onlinebayes.criticism.judging.contrasts import contrast_p_values, owners, parts_of_runs
from onlinebayes.criticism.judging.score import cross_validate
from onlinebayes.criticism.searching.per_run_parameters import find_differing, split_by_run
from onlinebayes.criticism.searching.search import ground
from onlinebayes.criticism.searching.stage import run_stage
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import ConstantLoad, DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import measure, model
from tests.criticism.test_scope import DAMPING, MASS, MASSES, weighed

LOAD = ConstantLoad("rail", Parameter(-5.0, 5.0, "N"))
FRICTION = DryFriction("rail", Parameter(0.0, 5.0, "N"))
SELECTION = Selection()


def judged(data: Measurement, effects: tuple = ()) -> tuple:
    """What is said of the slide's parameters, beside these effects."""
    base = ground(model(), data, SELECTION)
    stage = run_stage(base.fitted, base.windows, effects, base.numerics, SELECTION)
    return find_differing(base.fitted, base.windows, stage, data.runs, SELECTION)


def swung(masses: tuple[float, ...], seconds: float = 4.0) -> Measurement:
    """Runs of the driven pendulum, one for each mass of its bob [kg], through its encoder."""
    protocol = Protocol(fit=1, held=0, seconds=seconds)
    sets = record([({**NOMINAL, BOB: mass}, seed) for seed, mass in enumerate(masses)], protocol)
    table = {
        f"swing{k}": {"time": s.times.numpy(), "ctrl.motor": s.command[0].numpy(), "qpos.hinge": s.angle[0].numpy()}
        for k, s in enumerate(sets)
    }
    encoder = sets[0].encoder
    signal = Signal("qpos.hinge", "rad", sd=encoder.sd, resolution=encoder.resolution)
    return Measurement.from_runs(table, signals=[signal], commands=["motor"])


@pytest.mark.slow
def test_a_pendulum_whose_mass_changes_between_runs_is_called_that() -> None:
    masses = (0.36, 0.36, 0.44, 0.44, 0.36, 0.44, 0.40, 0.40)
    free = ParameterSpace({BOB: Parameter(0.1, 1.0, "kg"), HINGE: Parameter(0.0, 0.1, "N m s/rad")})
    few = ["dry_friction", "constant_load", "actuator_gain"]
    data = swung(masses)
    result = refine(MujocoSimulator(MODEL, free, threads=1), data, holdout=data.runs[6:], candidates=few)
    assert (result.verdict, result.accepted) == ("unexplained", ())
    (change,) = result.changes
    assert change.parameter == BOB
    assert f'"{BOB}" = {{ low = 0.1, high = 1, scope = "per_run" }}' in change.lines
    for run, mass in zip(data.runs[:6], masses, strict=False):
        value = change.values[run]
        assert abs(value.mean - mass) < max(4 * value.sd, 2e-3)
    assert change.score_gain > 2 * change.score_gain_se
    assert result.remainder.status == "noise"
    assert result.heldout_error.after["qpos.hinge"] < 0.5 * result.heldout_error.before["qpos.hinge"]


def test_values_and_the_parameter_are_found_on_the_slide() -> None:
    best, *others = judged(weighed(MASSES))
    assert best.address == MASS
    assert best.failed == ()
    assert all(other.gain.gain < best.gain.gain for other in others)
    found = best.fitted.theta[: len(MASSES)]
    torch.testing.assert_close(found, found.new_tensor(MASSES), atol=5e-3, rtol=0)


@pytest.mark.parametrize("hidden", [{FRICTION: (1.0,)}, {LOAD: (0.5,)}], ids=["friction", "load"])
def test_a_law_is_no_change(hidden) -> None:
    assert [one.address for one in judged(measure(hidden, runs=9)) if not one.failed] == []


@pytest.mark.slow
def test_null_sets_stay_silent() -> None:
    """Five sets of six runs, level .015: more than one below it comes about in one of 450 such tests."""
    low = 0
    for seed in range(5):
        data = measure(runs=6, seconds=4.0, seed=100 * seed)
        base = ground(model(), data, SELECTION)
        p_values = contrast_p_values(base.fitted, base.windows, (MASS, DAMPING), 0.0)
        assert set(p_values) == {MASS, DAMPING}
        low += min(p_values.values()) < 0.015
    assert low <= 1


def test_one_run_says_nothing_of_others() -> None:
    base = ground(model(), measure(runs=1, seconds=9.0), SELECTION)
    assert contrast_p_values(base.fitted, base.windows, (MASS,), 0.0) == {}


def test_what_is_cut_into_runs_is_the_same_fit() -> None:
    data = weighed(MASSES[:3], seconds=4.0)
    base = ground(model(), data, SELECTION)
    apart = split_by_run(base.fitted, base.windows, data.runs, MASS)
    assert isinstance(apart.simulator, ScopedSimulator)
    assert apart.theta.tolist() == base.fitted.theta[[0, 0, 0, 1]].tolist()
    torch.testing.assert_close(apart.projected.columns[..., :3].sum(-1), base.fitted.projected.columns[..., 0])
    stage = run_stage(base.fitted, base.windows, (), base.numerics, SELECTION)
    first_order = cross_validate(apart, base.windows, stage.blocks)
    assert first_order.rms_long < 0.5 * stage.scores.rms_long


def test_every_run_has_parts_of_its_own() -> None:
    base = ground(model(), measure(runs=5, seconds=6.0), SELECTION)
    owner = owners(base.fitted.simulator, base.windows)
    parts = parts_of_runs(base.windows, owner, 0.0)
    assert sorted(set(parts.tolist())) == list(range(int(parts.max()) + 1))
    for part in parts.unique():
        assert len(owner[parts == part].unique()) == 1
    alone = parts_of_runs(base.windows, owner, 100.0)
    assert torch.equal(alone, owner)


def test_a_change_that_differs_within_the_runs_is_none() -> None:
    """In the second half of every run the motor is stronger or weaker than the table says: a mean is no run's value."""
    data = measure(runs=4, seconds=4.0)
    mixed = dataclasses.replace(data, data=data.data.clone())
    rows = mixed.data["command"].shape[1] // 2
    mixed.data["command"][:, rows:] *= torch.tensor([0.7, 1.3, 1.0, 0.8], dtype=torch.float64)[:, None, None]
    assert all(change.failed for change in judged(mixed))
