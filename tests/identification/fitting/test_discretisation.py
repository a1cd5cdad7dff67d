"""The integrator's own errors are not physics: found out, mended by a finer step, and never named as a delay."""

import math

import mujoco
import pytest

from onlinebayes.criticism import compare, refine
from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.identification.replaying.integration import Integration
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Identifiable
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, measure, model

EULER = SLIDE.replace('integrator="RK4"', 'integrator="Euler"')
SHIFTS = ["dry_friction", "constant_load", "actuator_lag", "actuator_delay", "sensor_delay"]
"""What an integrator's shift in time could pass for, and what it could not."""


class OneIntegrator(MujocoSimulator):
    """A simulator that knows Euler only."""

    with_runge_kutta = Identifiable.with_runge_kutta


class RungeKuttaAlone(MujocoSimulator):
    """A simulator that knows no method of first order."""

    with_first_order = Identifiable.with_first_order


def test_an_integration_changes_step_and_method_and_nothing_else() -> None:
    simulator = MujocoSimulator(EULER, FREE)
    assert Integration(simulator.timestep).of(simulator) is simulator
    model = Integration(0.002, "runge_kutta").of(simulator).model
    assert (model.opt.timestep, model.opt.integrator) == (0.002, mujoco.mjtIntegrator.mjINT_RK4)


def way_of(simulator: Identifiable, measurement: Measurement) -> Integration:
    """How the fitted base model is integrated."""
    search = start_search(simulator, measurement)
    return search.evaluator.refined(search.base).discretisation.values


def test_a_first_order_integrator_is_given_finer_steps() -> None:
    measurement = measure(runs=8, noise=5e-4)
    assert way_of(model(), measurement).timestep == pytest.approx(0.01)
    assert way_of(OneIntegrator(EULER, FREE, threads=1), measurement).timestep < 0.01


def test_a_step_at_the_end_of_stability_is_not_taken() -> None:
    """Runge's and Kutta's steps are stable below 2.79 m / d, 6.2 ms here: steps of 5 ms do for this theta alone."""
    free = ParameterSpace({"joint.rail.damping": Parameter(100.0, 2000.0, "N s/m")})
    xml = SLIDE.replace('timestep="0.01"', 'timestep="0.001"').replace('damping="1"', 'damping="900"')
    stiff = RungeKuttaAlone(xml, free, threads=1)
    measurement = measure(runs=8, simulator=stiff, truth=(900.0,), finer=20)
    assert way_of(stiff, measurement).timestep == pytest.approx(0.002)


def stiff_slide() -> MujocoSimulator:
    """Euler's method takes a joint's damping implicitly, Runge's and Kutta's diverges here above .6 ms."""
    free = ParameterSpace({"joint.rail.damping": Parameter(1e3, 5e4, "N s/m")})
    xml = EULER.replace('damping="1"', 'damping="9000"').replace("<motor", '<motor gear="9000"')
    stiff = MujocoSimulator(xml, free, threads=1)
    assert stiff.with_runge_kutta() is not stiff
    return stiff


def test_damping_too_stiff_for_runge_kutta_is_judged_by_the_own_method() -> None:
    stiff = stiff_slide()
    found = compare(stiff, measure(runs=8, simulator=stiff, truth=(7000.0,), noise=5e-4))
    assert math.isfinite(found.numerics.error_at_quarter_step)
    assert found.remainder.rms_over_floor["qpos.rail"] == pytest.approx(1.0, abs=0.2)


@pytest.mark.slow
def test_what_is_too_stiff_for_runge_kutta_and_needs_more_is_extrapolated() -> None:
    stiff = stiff_slide()
    sharp = measure(runs=8, simulator=stiff, truth=(7000.0,), noise=1e-7, finer=16)
    assert way_of(stiff, sharp).method == "extrapolated"
    found = compare(stiff, sharp)
    assert found.verdict == "adequate"
    assert found.parameters["joint.rail.damping"].mean == pytest.approx(7000.0, rel=1e-3)


@pytest.mark.slow
def test_friction_calls_for_a_finer_step_than_the_smooth_model() -> None:
    friction = DryFriction("rail", Parameter(0.0, 5.0, "N"))
    measurement = measure({friction: (0.5,)}, runs=3, seconds=2.0, noise=2e-4, finer=4)
    smooth, rough = (way_of(one, measurement) for one in (model(), model().with_effect(friction)))
    assert rough.timestep < smooth.timestep


@pytest.mark.slow
def test_an_integrator_that_stays_too_coarse_names_nothing() -> None:
    # At a noise of 0.1 mm not even a sixteenth of the step brings Euler's error below a tenth of it.
    result = refine(OneIntegrator(EULER, FREE, threads=1), measure(runs=8), candidates=SHIFTS)
    assert not result.numerics.sufficient
    assert result.accepted == ()
    assert any("numerics" in note for note in result.notes)


@pytest.mark.slow
def test_a_model_integrated_by_euler_is_judged_by_runge_kutta_and_says_so() -> None:
    result = refine(MujocoSimulator(EULER, FREE, threads=1), measure(runs=8), candidates=SHIFTS)
    assert (result.verdict, result.accepted) == ("adequate", ())
    assert result.numerics.timestep == pytest.approx(0.01)
    (note,) = [note for note in result.notes if note.startswith("numerics")]
    assert "by Runge-Kutta's method" in note
    assert "not exact enough for these sensors" in note
    assert result.final.simulator.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


@pytest.mark.long
def test_a_true_delay_shorter_than_the_step_is_found_where_the_integrator_is_exact() -> None:
    delay = ActuatorDelay("motor", Parameter(0.0, 0.1, "s"))
    result = refine(model(), measure({delay: (0.006,)}, runs=10), candidates=["actuator_delay", "dry_friction"])
    assert result.accepted == ("actuator_delay@motor",)
    assert result.parameters["actuator_delay@motor.delay"].mean == pytest.approx(0.006, abs=2e-4)
