"""Extrapolation from two steps: second order where the model's own method has first, with whatever is around it."""

import pytest
import torch

from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.replaying.extrapolated import coarse_and_fine, in_one_step
from onlinebayes.identification.replaying.integration import Integration, reported
from onlinebayes.identification.replaying.replay import replay, rollout
from onlinebayes.identification.replaying.scoped import ScopedSimulator
from onlinebayes.identification.scope import Scope
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators import Identifiable
from onlinebayes.simulators.effects import ActuatorDelay, ActuatorLag, Effect, SensorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.criticism.rigs import measure

STEP = 0.01
STIFF = f"""
<mujoco><option timestep="{STEP}" integrator="implicitfast" gravity="0 0 -9.81"/><worldbody><body name="cart">
  <joint name="rail" type="slide" axis="1 0 0" damping="1"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
</body></worldbody><actuator><position name="motor" joint="rail" kp="2000" kv="900"/></actuator></mujoco>"""
FREE = ParameterSpace({"body.cart.mass": Parameter(0.5, 8.0, "kg")})
EFFECTS = {
    "none": (),
    "a delay": (ActuatorDelay("motor", Parameter(0.0, 0.1, "s")),),
    "a lag": (ActuatorLag("motor", Parameter(0.0, 0.1, "s")),),
    "a late sensor": (SensorDelay("qpos.rail", Parameter(0.0, 0.1, "s")),),
}
SPANS = ((2.0, 2.0), (2.0, 1.5), (0.0, 0.7))
"""Of the logarithms of kp, kv and mass: least, and how much more."""
THETA = {"none": (2.5,), "a delay": (2.5, 0.03), "a lag": (2.5, 0.03), "a late sensor": (2.5, 0.03)}


def servo(effects: tuple[Effect, ...] = ()) -> MujocoSimulator:
    simulator = MujocoSimulator(STIFF, FREE, threads=1)
    for effect in effects:
        simulator = simulator.with_effect(effect)
    return simulator


def windows_of(simulator: Identifiable) -> Windows:
    return make_windows(simulator, measure(runs=2, seconds=2.0, simulator=servo(), truth=(2.5,)), 0.5, 0.1)


def shown(way: Integration, simulator: Identifiable, windows: Windows, theta: tuple[float, ...]) -> torch.Tensor:
    signals, valid = replay(way.of(simulator), windows, torch.tensor([theta]).double(), windows.start[None])
    assert bool(valid.all())
    return signals[0]


@pytest.mark.parametrize("which", EFFECTS)
def test_three_evaluations_err_less_than_sixteen(which: str) -> None:
    simulator, theta = servo(EFFECTS[which]), THETA[which]
    windows = windows_of(simulator)
    finest = shown(Integration(STEP / 64), simulator, windows, theta)
    exact = 2 * finest - shown(Integration(STEP / 32), simulator, windows, theta)
    error = {
        name: float((shown(way, simulator, windows, theta) - exact).square().mean().sqrt())
        for name, way in {
            "extrapolated": Integration(STEP, "extrapolated"),
            "halved": Integration(STEP / 2, "extrapolated"),
            "own": Integration(STEP),
            "sixteenth": Integration(STEP / 16),
        }.items()
    }
    assert error["extrapolated"] < error["sixteenth"] < error["own"] / 10
    assert error["halved"] < error["extrapolated"] / 3, "of second order: a quarter of the error"


def test_values_of_one_run_go_with_it() -> None:
    scope, windows = Scope(per_run=("body.cart.mass",)), windows_of(servo())
    simulator = ScopedSimulator(servo(), scope, windows.runs)
    theta = (2.0, 3.0)
    found = shown(Integration(STEP, "extrapolated"), simulator, windows, theta)
    for r, value in enumerate(theta):
        mine = windows.run == r
        alone = shown(Integration(STEP, "extrapolated"), servo(), windows, (value,))
        assert torch.equal(found[mine], alone[mine])


def test_a_replay_is_that_of_two_steps_and_nothing_else_changes() -> None:
    simulator = Integration(STEP, "extrapolated").of(servo())
    windows = windows_of(simulator)
    theta = torch.tensor([[2.5]]).double()
    two = coarse_and_fine(simulator)
    assert two is not None
    coarse, fine = (rollout(one, windows, theta, windows.start[None]) for one in two)
    found = rollout(simulator, windows, theta, windows.start[None])
    torch.testing.assert_close(found["qpos"], 2 * fine["qpos"] - coarse["qpos"])
    assert [one.timestep for one in (*two, simulator, in_one_step(simulator))] == [STEP, STEP / 2, STEP, STEP]
    assert coarse_and_fine(in_one_step(simulator)) is None
    assert simulator.parameters == servo().parameters


def test_a_report_integrates_by_itself_in_small_steps() -> None:
    assert reported(servo(), Integration(STEP, "extrapolated").of(servo())) == Integration(STEP / 16)
    assert reported(servo(), servo()) == Integration(STEP)


def errors_of_a_drawn_servo(seed: int) -> tuple[float, float, float]:
    """RMS error by three, twelve and sixteen evaluations a step; gains, damping and mass are drawn [SI]."""
    draw = torch.Generator().manual_seed(seed)
    kp, kv, mass = (10 ** (low + width * torch.rand((), generator=draw).item()) for low, width in SPANS)
    xml = STIFF.replace('"2000"', f'"{kp}"').replace('"900"', f'"{kv}"')
    simulator, windows = MujocoSimulator(xml, FREE, threads=1), windows_of(servo())
    ways = [Integration(STEP, "extrapolated"), Integration(STEP / 4, "extrapolated"), Integration(STEP / 16)]
    exact, three, twelve, sixteen = (
        shown(way, simulator, windows, (mass,)) for way in (Integration(STEP / 64, "extrapolated"), *ways)
    )
    return tuple(float((one - exact).square().mean().sqrt()) for one in (three, twelve, sixteen))  # type: ignore[return-value]


@pytest.mark.slow
def test_on_servos_that_nobody_looked_at_twelve_evaluations_err_less_than_sixteen() -> None:
    found = [errors_of_a_drawn_servo(seed) for seed in range(71000, 71020)]
    assert sum(twelve < sixteen for _, twelve, sixteen in found) == len(found)
    assert sum(three < sixteen for three, _, sixteen in found) > len(found) / 2
