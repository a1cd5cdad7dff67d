"""The systems of measured machines: the contract of simulators and effects, and motions known in closed form."""

import math
import sys
from collections.abc import Iterator

import pytest
import torch
from tensordict import TensorDict

from envs.measured.dart_car import SingleTrack
from envs.measured.dart_car.single_track import GRAVITY, MASS_FRONT, MASS_REAR, WHEELBASE
from envs.measured.dart_car.tyres import TyreSaturation
from envs.measured.skid_steer import SkidSteer, Warthog, build_warthog
from envs.measured.skid_steer.driver import TravelAcceleration, TurnAcceleration, TurnLimit, WheelSaturation
from envs.measured.skid_steer.laws import SideAsymmetry, TurningSlip
from onlinebayes.parameters import Parameter
from onlinebayes.problems import import_module
from onlinebayes.runs import BadInput
from onlinebayes.simulators import TorchSimulator
from onlinebayes.simulators.effects import EFFECTS, Effect
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_effect, check_simulator

SERVO = """
<mujoco><option timestep="0.005" integrator="implicitfast" gravity="0 0 0"/>
  <worldbody><body name="arm"><joint name="servo" type="hinge" axis="0 1 0"/>
    <geom type="sphere" pos="0 0 -0.1" size="0.02" mass="1"/></body></worldbody>
  <actuator><position name="goal" joint="servo" kp="10" kv="0.5"/></actuator></mujoco>"""
CURVATURE = Parameter(0.0, 20.0, "1/rad")
ROUNDING = 1e-11  # trigonometric functions round differently with the size of a batch


def driven(system: TorchSimulator, command: list[float], seconds: float, speed: float = 0.0) -> TensorDict:
    """The last state of a nominal world after these seconds under one command, from this speed along x."""
    v = torch.zeros(1, len(system.joints), dtype=torch.float64)
    v[0, [joint.name for joint in system.joints].index("x")] = speed
    state = TensorDict({"qpos": torch.zeros_like(v), "qvel": v}, batch_size=(1,))
    inputs = TensorDict({"command": torch.tensor([[command]]).double()}, batch_size=(1, 1))
    return system.rollout(system.nominal[None], state, inputs, torch.tensor([seconds]).double())[0, 0]


@pytest.mark.parametrize(
    "system",
    [SkidSteer(["radius", "track", "x_icr", "wheel_lag"]), SingleTrack(["steering_trim", "cornering_front", "gear"])],
)
def test_they_keep_the_contract_of_simulators(system: TorchSimulator) -> None:
    check_simulator(system, atol=ROUNDING)


@pytest.mark.parametrize(
    ("system", "law"),
    [
        (SkidSteer(["radius"]), TurningSlip("vehicle", Parameter(0.0, 1.0, "s/rad"))),
        (SkidSteer(["radius"]), SideAsymmetry("vehicle", Parameter(-0.3, 0.3, "1"))),
        (SkidSteer(["radius"]), WheelSaturation("vehicle", Parameter(0.1, 100.0, "rad/s"))),
        (SkidSteer(["radius"]), TurnLimit("vehicle", Parameter(0.1, 100.0, "rad/s"))),
        (SkidSteer(["radius"]), TravelAcceleration("vehicle", Parameter(0.1, 1e4, "rad/s^2"))),
        (SkidSteer(["radius"]), TurnAcceleration("vehicle", Parameter(0.1, 1e4, "rad/s^2"))),
        (SingleTrack(["steering_angle"]), TyreSaturation("front", CURVATURE)),
        (SingleTrack(["steering_angle"]), TyreSaturation("rear", CURVATURE)),
    ],
)
def test_their_laws_keep_the_contract_of_effects(system: TorchSimulator, law: Effect) -> None:
    check_effect(system, law, atol=ROUNDING)


def test_a_law_belongs_to_its_own_system() -> None:
    with pytest.raises(BadInput, match="has no form in torch"):
        SkidSteer(["radius"]).with_effect(TyreSaturation("front", CURVATURE))
    with pytest.raises(BadInput, match="nearest: front"):
        SingleTrack(["gear"]).with_effect(TyreSaturation("fron", CURVATURE))


def limited(limit: Effect, theta: list[float], command: list[float], seconds: float) -> list[float]:
    """Speeds of the left and the right wheels from rest, under one command and one limit of the driver [rad/s]."""
    vehicle = SkidSteer(["wheel_lag"]).with_effect(limit)
    state = TensorDict({"qpos": torch.zeros(1, 5), "qvel": torch.zeros(1, 5)}, batch_size=(1,)).double()
    inputs = TensorDict({"command": torch.tensor([[command]]).double()}, batch_size=(1, 1))
    end = vehicle.rollout(torch.tensor([theta]).double(), state, inputs, torch.tensor([seconds]).double())[0, 0]
    return end["qvel"][:2].tolist()


def test_no_wheel_turns_faster_than_its_limit_and_the_path_keeps_its_curvature() -> None:
    saturation = WheelSaturation("vehicle", Parameter(0.1, 100.0, "rad/s"))
    assert limited(saturation, [0.1, 6.0], [5.0, 7.0], 4.0) == pytest.approx([6.0 * 5 / 7, 6.0], abs=1e-6)


def test_a_driver_cuts_off_the_turn_alone() -> None:
    turn = TurnLimit("vehicle", Parameter(0.1, 100.0, "rad/s"))
    assert limited(turn, [0.1, 2.0], [-2.0, 6.0], 4.0) == pytest.approx([0.0, 4.0], abs=1e-6)  # travel 2, turn 4


def test_a_driver_speeds_up_along_a_ramp() -> None:
    travel = TravelAcceleration("vehicle", Parameter(0.1, 1e4, "rad/s^2"))
    assert limited(travel, [0.02, 3.0], [8.0, 8.0], 1.5) == pytest.approx([4.5, 4.5])
    turn = TurnAcceleration("vehicle", Parameter(0.1, 1e4, "rad/s^2"))
    left, right = limited(turn, [0.02, 3.0], [0.0, 16.0], 1.5)
    assert (right - left) / 2 == pytest.approx(4.5)
    assert (right + left) / 2 == pytest.approx(8.0)


@pytest.fixture
def rate_limit() -> Iterator[type[Effect]]:
    """As a problem file's module has it; gone from the vocabulary after the test."""
    _forget_rate_limit()  # another test of this process may have left it
    yield import_module("envs.measured.sts3250.rate_limit").ActuatorRateLimit
    _forget_rate_limit()


def _forget_rate_limit() -> None:
    EFFECTS.pop("actuator_rate_limit", None)
    sys.modules.pop("envs.measured.sts3250.rate_limit", None)


def test_a_rate_limit_keeps_the_contract_of_effects(rate_limit: type[Effect]) -> None:
    limit = rate_limit("goal", Parameter(0.5, 60.0))  # type: ignore[call-arg]
    check_effect(MujocoSimulator(SERVO), limit, atol=ROUNDING)


def test_a_goal_that_jumps_is_reached_along_a_ramp(rate_limit: type[Effect]) -> None:
    limit = rate_limit("goal", Parameter(0.5, 60.0))  # type: ignore[call-arg]
    parameters = {"limit": torch.tensor([2.0, 60.0]).double()}
    goal = torch.tensor([[1.0, 1.0, 1.0, -1.0, -1.0]]).double().expand(2, -1)
    reached, after = limit.command(parameters, None, goal, 0.2)
    assert reached[0].tolist() == pytest.approx([0.4, 0.8, 1.0, 0.6, 0.2])
    assert after is not None
    assert after["reached"].tolist() == pytest.approx([0.2, -1.0])
    assert torch.equal(reached[1], goal[1])  # at its upper bound it is none


def test_wheels_that_turn_alike_drive_straight_and_others_turn_about_the_centre_of_rotation() -> None:
    vehicle = SkidSteer(["radius"])
    r, b = vehicle.defaults["radius"], vehicle.defaults["track"]
    straight = driven(vehicle, [3.0, 3.0], 4.0)
    assert straight["qvel"][2:].tolist() == pytest.approx([3.0 * r, 0.0, 0.0], abs=1e-6)
    turning = driven(vehicle, [-2.0, 2.0], 4.0)
    assert turning["qvel"][2:].tolist() == pytest.approx([0.0, 0.0, 4.0 * r / b], abs=1e-6)


def test_a_warthog_is_the_same_model_of_another_size() -> None:
    warthog = build_warthog(SkidSteer.physical.subspace(["x_icr", "radius"]))
    assert warthog.nominal.tolist() == [0.0, Warthog.defaults["radius"]]
    assert SkidSteer(["radius"]).nominal.tolist() == [SkidSteer.defaults["radius"]]
    forward, slow = driven(warthog, [3.0, 3.0], 4.0), driven(SkidSteer(), [3.0, 3.0], 4.0)
    assert float(forward["qvel"][2]) == pytest.approx(0.9, abs=1e-6)
    assert float(slow["qvel"][2]) == pytest.approx(0.495, abs=1e-6)


def test_a_car_turns_as_its_understeer_gradient_says() -> None:
    """Steady turn of a linear single track: r = v delta / (L + K v u), K = (1 / c_f - 1 / c_r) / g.

    u is what slip angles are taken against, v itself but for the softening near standstill.
    """

    class Steady(SingleTrack):
        defaults = {  # noqa: RUF012
            **SingleTrack.defaults,
            "steering_angle": 0.02,
            "cornering_front": 4.0,
            "cornering_rear": 8.0,
            "gear": 0.0,
            "damping": 0.0,
            "rolling": 0.0,
        }

    end = driven(Steady(["grip"]), [0.0], 3.0, speed=1.0)
    rate = float(end["qvel"][2])
    v = float(end["qvel"][:2].norm())
    loads = (MASS_FRONT * WHEELBASE / 0.093, MASS_REAR * WHEELBASE / (WHEELBASE - 0.093))
    assert loads == pytest.approx((MASS_FRONT + MASS_REAR,) * 2, rel=2e-3)  # the weighed loads fit the centre of mass
    gradient = (1 / 4.0 - 1 / 8.0) / GRAVITY
    assert rate == pytest.approx(v * 0.02 / (WHEELBASE + gradient * v * math.hypot(v, 0.5)), rel=0.01)
