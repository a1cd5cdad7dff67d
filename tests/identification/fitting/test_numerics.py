"""The integrator's own errors are not physics: found out, mended by a finer step, and never named as a delay."""

import mujoco
import pytest
import torch

from onlinebayes.criticism import refine
from onlinebayes.identification.data.noise import noise_floors
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.numerics import Grounds, _too_coarse, check, settle
from onlinebayes.identification.replaying.ladder import Rung, ladder
from onlinebayes.measurements import Measurement
from onlinebayes.parameters import Parameter
from onlinebayes.simulators import Identifiable
from onlinebayes.simulators.effects import ActuatorDelay, DryFriction, StribeckFriction
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import FREE, SLIDE, measure, model

EULER = SLIDE.replace('integrator="RK4"', 'integrator="Euler"')
SHIFTS = ["dry_friction", "constant_load", "actuator_lag", "actuator_delay", "sensor_delay"]
"""What an integrator's shift in time could pass for, and what it could not."""


class OneIntegrator(MujocoSimulator):
    """A simulator that knows Euler only."""

    with_runge_kutta = Identifiable.with_runge_kutta


def test_the_ladder_goes_down_to_a_sixteenth() -> None:
    own = [Rung(0.01), Rung(0.005), Rung(0.0025)]
    fine = [Rung(0.000625), Rung(0.00015625)]
    cheap = Rung(0.01, "first_order")
    assert ladder(MujocoSimulator(SLIDE.replace("0.01", "0.0025"), FREE), 1.0, 0.01) == [cheap, *own, *fine]
    smooth = [Rung(step, "runge_kutta") for step in (0.01, 0.005, 0.0025, 0.00125, 0.000625)]
    assert ladder(MujocoSimulator(EULER.replace("0.01", "0.0025"), FREE), 1.0, 0.01) == [*own, *smooth, *fine]
    assert ladder(OneIntegrator(EULER.replace("0.01", "0.0025"), FREE), 1.0, 0.01) == [*own, *fine]


def test_rows_fall_on_the_steps_of_every_rung() -> None:
    simulator = MujocoSimulator(SLIDE.replace("0.01", "0.002"), FREE)
    for row, steps in ((0.01, [0.01, 0.002]), (0.02, [0.01, 0.004, 0.002]), (0.006, [0.002]), (0.0205, [0.002])):
        coarse = [rung.timestep for rung in ladder(simulator, 1.0, row)[1:] if rung.timestep >= simulator.timestep]
        assert coarse == pytest.approx(steps), row


def test_a_rung_changes_step_and_method_and_nothing_else() -> None:
    simulator = MujocoSimulator(EULER, FREE)
    assert Rung(simulator.timestep).of(simulator) is simulator
    model = Rung(0.002, "runge_kutta").of(simulator).model
    assert (model.opt.timestep, model.opt.integrator) == (0.002, mujoco.mjtIntegrator.mjINT_RK4)


@pytest.mark.slow
def test_the_shift_is_what_a_step_moves_theta() -> None:
    measurement = measure(runs=3, noise=2e-3)
    noise = noise_floors(measurement.signals, ())
    euler = OneIntegrator(EULER, FREE, threads=1)
    coarse = settle(euler, measurement, 1.0, noise)
    at = euler.with_timestep(coarse.rung.timestep / 32)
    fine = fit(at, make_windows(at, measurement, 1.0, like=coarse.windows), coarse.fitted.theta)
    # The shift's sign does not matter to a variance; a first-order integrator's is known to a few per cent.
    assert torch.allclose(coarse.shift.abs(), (fine.theta - coarse.fitted.theta).abs(), rtol=0.2)
    assert float((coarse.shift / coarse.fitted.theta).abs().max()) > 1e-4
    assert not bool(settle(model(), measurement, 1.0, noise).shift.abs().max() > 1e-5)


@pytest.mark.long
def test_how_fine_a_step_is_is_asked_of_the_fitted_model() -> None:
    # The delay is nothing where the fit begins, and the model exact there; fitted, half a row of it is not.
    late = ActuatorDelay("motor", Parameter(0.0, 0.1))
    measurement = measure({late: (0.025,)}, runs=4, noise=1e-5)
    simulator = model().with_effect(late)
    grounds = settle(
        simulator, measurement, 1.0, noise_floors(measurement.signals, ()), torch.tensor([5.0, 1.0, 0.0]).double()
    )
    now, _ = check(simulator, measurement, grounds.windows, grounds.fitted)
    assert grounds.numerics == now


@pytest.mark.slow
def test_a_first_order_integrator_is_given_finer_steps() -> None:
    measurement = measure(runs=8, noise=2e-3)
    noise = noise_floors(measurement.signals, ())
    exact = settle(model(), measurement, 1.0, noise)
    euler = settle(OneIntegrator(EULER, FREE, threads=1), measurement, 1.0, noise)
    assert exact.numerics.timestep == pytest.approx(0.01)
    assert euler.numerics.timestep < 0.01
    assert euler.numerics.sufficient
    assert euler.numerics.error_at_quarter_step < 0.11
    assert torch.allclose(exact.fitted.theta, euler.fitted.theta, rtol=2e-2)


@pytest.mark.long
def test_a_gross_misfit_takes_one_evaluation_a_step_and_is_reported_by_the_models_own_method() -> None:
    friction = DryFriction("rail", Parameter(0.0, 5.0, "N"))
    measurement = measure({friction: (2.0,)}, runs=8, noise=1e-3, finer=4)
    cheap, noise = Rung(0.01, "first_order"), noise_floors(measurement.signals, ())
    gross = settle(model(), measurement, 1.0, noise)
    assert (gross.rung, gross.numerics.sufficient) == (cheap, True)
    # Beside what friction leaves, the noise, an error of first order would matter.
    grown = settle(model().with_effect(friction), measurement, 1.0, noise, before=gross)
    assert grown.rung.method == "own"
    assert grown.numerics.sufficient
    result = refine(model(), measurement, candidates=["sensor_scale"])
    assert result.accepted == ()
    assert result.numerics.timestep == pytest.approx(0.01)
    for fitted in (result.base, result.final):
        assert fitted.simulator.model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4


def grounds(simulator: Identifiable, rung: Rung, measurement: Measurement, noise: float) -> Grounds:
    """The model fitted and checked on one rung, needed or not."""
    stepped = rung.of(simulator)
    windows = make_windows(stepped, measurement, 1.0, 0.1, torch.tensor([noise], dtype=torch.float64))
    fitted = fit(stepped, windows, torch.tensor([2.5, 1.4]).double())
    return Grounds(windows, fitted, *check(simulator, measurement, windows, fitted)[:1], rung, torch.zeros(2))


@pytest.mark.parametrize(("noise", "passed_by"), [(1e-5, True), (5e-2, False)])
def test_rungs_of_a_first_order_integrator_are_foretold(noise: float, passed_by: bool) -> None:
    euler, measurement = MujocoSimulator(EULER, FREE, threads=1), measure(runs=3, noise=noise)
    coarse = grounds(euler, Rung(0.01), measurement, noise)
    fine = grounds(euler, Rung(0.0025), measurement, noise)
    assert fine.numerics.error_at_quarter_step == pytest.approx(coarse.numerics.error_at_quarter_step / 4, rel=0.1)
    assert _too_coarse(euler, coarse, Rung(0.0025)) == passed_by == (not fine.numerics.sufficient)
    # Of another method's error, and where there is no other method to go to, nothing is foretold.
    assert not _too_coarse(euler, coarse, Rung(0.0025, "runge_kutta"))
    assert not _too_coarse(OneIntegrator(EULER, FREE, threads=1), coarse, Rung(0.0025))


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


@pytest.mark.slow
def test_friction_calls_for_a_finer_step_than_the_smooth_model() -> None:
    friction = DryFriction("rail", Parameter(0.0, 5.0, "N"))
    measurement = measure({friction: (0.5,)}, runs=3, seconds=2.0, noise=2e-4)
    noise = torch.tensor([2e-4], dtype=torch.float64)
    smooth = settle(model(), measurement, 1.0, noise)
    rough = settle(model().with_effect(friction), measurement, 1.0, noise)
    assert rough.numerics.timestep < smooth.numerics.timestep


def test_a_law_that_is_walked_is_not_walked_for_ever() -> None:
    simulator = MujocoSimulator(EULER.replace("0.01", "0.0025"), FREE)
    finest = Rung(0.0025 / 16)  # 6400 steps a window
    assert ladder(simulator, 1.0, 0.01)[-1] == finest
    stribeck = StribeckFriction("rail", Parameter(0.0, 5.0), Parameter(0.0, 5.0), Parameter(0.01, 1.0))
    assert ladder(simulator.with_effect(stribeck), 1.0, 0.01)[-1] == Rung(0.0025 / 4)
    # What the engine itself carries is quick at any step.
    assert ladder(simulator.with_effect(DryFriction("rail", Parameter(0.0, 5.0, "N"))), 1.0, 0.01)[-1] == finest
