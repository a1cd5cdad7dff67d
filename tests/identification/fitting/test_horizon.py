"""Windows of a machine that falls without its controller: as long as an error of their start takes to grow e-fold."""

import math

import numpy as np
import pytest
import torch

from onlinebayes.criticism import Selection, compare
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.horizon import growth, shortened, steady, within_runs
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism import rigs

MASS, LENGTH, INERTIA, GRAVITY, STEP = 0.5, 0.4, 0.02, 9.81, 0.01
RATE = math.sqrt(MASS * GRAVITY * LENGTH / (INERTIA + MASS * LENGTH**2))  # of the fall [1/s]
FREE = ParameterSpace({"body.rod.mass": Parameter(0.3, 0.8, "kg")})


def model(up: bool) -> MujocoSimulator:
    """A rod that stands on its hinge, or hangs from it."""
    height = LENGTH if up else -LENGTH
    xml = f"""
    <mujoco><option timestep="{STEP}" integrator="RK4"/><worldbody><body name="rod">
      <joint name="hinge" type="hinge" axis="0 1 0"/>
      <inertial pos="0 0 {height}" mass="{MASS}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
    </body></worldbody><actuator><motor name="motor" joint="hinge"/></actuator></mujoco>"""
    return MujocoSimulator(xml, FREE, threads=1)


def recorded(up: bool, runs: int = 9, seconds: float = 4.0, noise: float = 1e-4) -> Measurement:
    """The rod held near its rest by a controller that also shakes it; Runge and Kutta at a tenth of a row."""
    pull = MASS * GRAVITY * LENGTH * (1 if up else -1)
    inertia, draw, table = INERTIA + MASS * LENGTH**2, np.random.default_rng(0), {}

    def slope(state: np.ndarray, torque: float) -> np.ndarray:
        return np.array([state[1], (pull * math.sin(state[0]) + torque) / inertia])

    for r in range(runs):
        state, rows = np.zeros(2), []
        phase, frequency = draw.uniform(0, 6.3, 3), draw.uniform(0.3, 2.0, 3)
        for k in range(round(seconds / STEP) + 1):
            goal = 0.1 * float(np.sin(6.2832 * frequency * k * STEP + phase).sum())
            torque = 8.0 * (goal - state[0]) - 1.0 * state[1]
            rows.append((k * STEP, torque, *state))
            for _ in range(10):
                h, a = STEP / 10, slope(state, torque)
                b = slope(state + h / 2 * a, torque)
                c = slope(state + h / 2 * b, torque)
                state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c, torque))
        time, command, angle, _ = np.array(rows).T
        angle = angle + noise * draw.standard_normal(len(time))
        table[f"run{r}"] = {"time": time, "ctrl.motor": command, "qpos.hinge": angle}
    return Measurement.from_runs(table, signals=[Signal("qpos.hinge", "rad", sd=noise)], commands=["motor"])


def test_an_error_of_an_upright_rods_start_grows_as_the_cosine_hyperbolic_says() -> None:
    windows = make_windows(model(True), recorded(True), 1.0, 0.0)
    found = growth(model(True), windows).median(0).values
    time = (torch.arange(windows.bins) + 0.5) * windows.bin_step + windows.step / 2
    # Between 0 and 0.25 rad the pull is up to 3 % less than at the top.
    torch.testing.assert_close(found, torch.cosh(RATE * time).to(found), rtol=0.06, atol=0.0)


def test_an_upright_rods_windows_last_until_the_error_has_grown_e_fold() -> None:
    used = steady(model(True), recorded(True), Selection())
    assert used.horizon_s == pytest.approx(math.acosh(math.e) / RATE, rel=0.1)
    assert used.horizon_s < 0.5


def test_a_hanging_rod_keeps_its_windows() -> None:
    assert steady(model(False), recorded(False), Selection()) == Selection()


def test_a_horizon_that_was_asked_for_stands() -> None:
    asked = Selection(horizon_s=0.8, fixed_horizon=True)
    assert steady(model(True), recorded(True), asked) == asked


def test_a_shortened_horizon_is_not_shortened_again() -> None:
    once = steady(model(True), recorded(True), Selection())
    assert steady(model(True), recorded(True), once) == once


@pytest.mark.slow
def test_the_report_says_that_windows_were_shortened() -> None:
    result = compare(model(True), recorded(True))
    (told,) = shortened(Selection(), result.selection)
    assert told in result.notes
    assert result.heldout_error.horizon_s["qpos.hinge"] == pytest.approx(result.selection.horizon_s)
    assert max(result.remainder.rms_over_floor.values()) < 1.2
    assert not shortened(Selection(), Selection())


@pytest.mark.slow
def test_windows_are_no_longer_than_the_longest_run() -> None:
    """A billion seconds of commands before a window would be more than there is memory."""
    measurement = rigs.measure(runs=8)
    for asked in (1e9, 5.0):
        result = compare(rigs.model(), measurement, selection=Selection(horizon_s=asked, fixed_horizon=True))
        assert result.selection.horizon_s == 3.0
        assert f"windows last 3 s in place of {asked:g} s: no run is longer" in result.notes
    own = Selection(horizon_s=5.0)
    assert within_runs(own, measurement) is own
