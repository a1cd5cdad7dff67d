from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import (
    EFFECTS,
    ActuatorDelay,
    ActuatorGain,
    ComOffset,
    ConstantLoad,
    CubicStiffness,
    DryFriction,
    Effect,
    JointStiffness,
    QuadraticDrag,
    Scales,
    Seen,
    ViscousFriction,
)
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_effect
from tests.simulators.models import ARM, SLIDE

H, MASS = 0.002, 2.0
ELBOW = Scales(force=4.0, speed=6.0, travel=3.0, time=0.05, centre=0.4, inertia=0.04, output=20.0)


def _effects() -> list[Effect]:
    # The arm is planar: the centre of mass moves along one axis that matters.
    places = {"joint": "elbow", "actuator": "bend", "body": "fore", "world": "world", "signal": "qpos.elbow"}
    # Nothing of it touches anything in a few steps; effects on contacts and on parameters have tests of their own.
    tried = [cls for cls in EFFECTS.values() if cls.target_kind in places]
    return [cls.scaled("fore.x" if cls is ComOffset else places[cls.target_kind], ELBOW) for cls in tried]


def _roll(
    simulator: MujocoSimulator, theta: list[float], command: Tensor, q: float = 0.0, v: float = 0.0
) -> TensorDict:
    steps = len(command)
    state = TensorDict({"qpos": torch.tensor([[q]]).double(), "qvel": torch.tensor([[v]]).double()}, batch_size=[1])
    times = simulator.timestep * torch.arange(1, steps + 1, dtype=torch.float64)
    inputs = TensorDict({"command": command.double().reshape(1, steps, 1)}, batch_size=[1, steps])
    return simulator.rollout(torch.tensor([theta], dtype=torch.float64), state, inputs, times)[0]


def _seen(q: float, v: float, drive: float = 0.0) -> Seen:
    q, v, drive = (torch.tensor([x], dtype=torch.float64) for x in (q, v, drive))
    return Seen(q, v, drive, torch.zeros_like(q), None, H)


def test_the_registry_holds_the_contracts_names() -> None:
    assert tuple(EFFECTS) == (
        "viscous_friction",
        "dry_friction",
        "stribeck_friction",
        "load_dependent_friction",
        "load_dependent_stribeck",
        "quadratic_load_friction",
        "asymmetric_friction",
        "quadratic_drag",
        "joint_stiffness",
        "cubic_stiffness",
        "constant_load",
        "backlash",
        "cogging",
        "armature",
        "payload",
        "com_offset",
        "air_drag",
        "wind",
        "gravity_tilt",
        "actuator_gain",
        "actuator_lag",
        "actuator_delay",
        "actuator_dead_zone",
        "actuator_saturation",
        "back_emf",
        "servo_law",
        "thermal_derating",
        "sensor_bias",
        "sensor_scale",
        "sensor_delay",
        "sensor_clock",
        "contact_friction",
        "contact_softness",
        "parameter_drift",
        "parameter_step",
    )
    assert all(cls.name == name for name, cls in EFFECTS.items())


@pytest.mark.parametrize("effect", _effects(), ids=lambda e: e.name)
@pytest.mark.parametrize("timesteps", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_conformance_on_mujoco(effect: Effect, timesteps: int) -> None:
    space = ParameterSpace({"body.fore.mass": Parameter(0.3, 2.0, "kg"), "joint.elbow.damping": Parameter(0.0, 1.0)})
    check_effect(MujocoSimulator(ARM, space, dt=0.004 * timesteps), effect)


@pytest.mark.slow
def test_conformance_of_all_together() -> None:
    simulator = MujocoSimulator(ARM)
    # A servo's law is the dead zone, the limit and the back-EMF together: beside them it has nothing left to do.
    *first, last = [effect for effect in _effects() if effect.name != "servo_law"]
    for effect in first:
        simulator = simulator.with_effect(effect)
    # Commands that come through the dead zone, also when lagged.
    check_effect(simulator, last, scale=10.0)


@pytest.mark.parametrize(
    ("effect", "theta", "law"),
    [
        (ViscousFriction("rail", Parameter(0, 9)), [3.0], lambda q, v: -3.0 * v),
        (QuadraticDrag("rail", Parameter(0, 9)), [3.0], lambda q, v: -3.0 * v * abs(v)),
        (
            JointStiffness("rail", Parameter(0, 9), Parameter(-1, 1)),
            [3.0, 0.25],
            lambda q, v: -3.0 * (q - 0.25),
        ),
        (CubicStiffness("rail", Parameter(0, 9), Parameter(-1, 1)), [3.0, 0.25], lambda q, v: -3.0 * (q - 0.25) ** 3),
        (ConstantLoad("rail", Parameter(-9, 9)), [-3.0], lambda q, v: -3.0),
    ],
    ids=lambda x: getattr(x, "name", ""),
)
def test_laws_of_forces_on_both_backends(effect: Effect, theta: list[float], law) -> None:
    # Over one timestep of a microsecond the gain of velocity is the law's force at its start to 1e-4.
    simulator = MujocoSimulator(SLIDE.replace("0.002", "1e-6")).with_effect(effect)
    named = dict(zip(effect.parameters, (torch.tensor([x]).double() for x in theta), strict=True))
    for q, v in ((0.1, 2.0), (-0.3, -1.5), (0.4, 0.0)):
        after = _roll(simulator, theta, torch.zeros(1), q, v)
        acceleration = (float(after["qvel"][0, 0]) - v) / simulator.timestep
        assert acceleration == pytest.approx(law(q, v) / MASS, rel=1e-4, abs=1e-9)
        force = effect.force(named, _seen(q, v))
        assert float(force) == pytest.approx(law(q, v))


def test_dry_friction_slides_with_coulombs_force() -> None:
    simulator = MujocoSimulator(SLIDE).with_effect(DryFriction("rail", Parameter(0.0, 9.0, "N")))
    path = _roll(simulator, [3.0], torch.zeros(100), v=1.0)
    assert torch.allclose(path["qvel"][:, 0], 1.0 - 1.5 * H * torch.arange(1, 101).double(), rtol=0, atol=1e-4)
    # It stops after v / (F / m) = 0.67 s and stays.
    later = _roll(simulator, [3.0], torch.zeros(1000), v=1.0)
    assert float(later["qpos"][-1, 0]) == pytest.approx(1.0 / 3.0, rel=1e-2)
    assert float(later["qvel"][-1, 0]) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_creep_below_breakaway_is_bounded(integrator: str, share: float) -> None:
    # The case of a light rotor, I = 1e-3 kg m2, F = .1 N m: with MuJoCo's defaults it creeps at .053 rad/s for a load
    # of F / 2. The bound is the module's: 1e-7 s (1e-4 timesteps) times the acceleration of the load alone.
    rotor = f"""
    <mujoco><option timestep="0.001" integrator="{integrator}" gravity="0 0 0"/><worldbody><body>
      <joint name="rail" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
    </body></worldbody><actuator><motor name="motor" joint="rail"/></actuator></mujoco>"""
    simulator = MujocoSimulator(rotor).with_effect(DryFriction("rail", Parameter(0.0, 1.0, "N m")))
    load = share * 0.1
    path = _roll(simulator, [0.1], torch.full((2000,), load))
    assert float(path["qvel"][500:].abs().max()) <= 1.1e-7 * load / 1e-3
    # Above breakaway it moves, by the force that is left.
    assert float(_roll(simulator, [0.1], torch.full((2000,), 0.15))["qvel"][-1, 0]) > 10.0


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_dry_friction_changes_sign_with_the_velocity(integrator: str) -> None:
    # Braked by 10 N against v = .1 m/s with F = 1 N, m = 1 kg: -11 m/s2 until v = 0, then -9. MuJoCo's softness would
    # turn the friction round 10 ms too early and leave v wrong by .02 m/s; here it is less than one timestep.
    slide = f"""
    <mujoco><option timestep="0.001" integrator="{integrator}" gravity="0 0 0"/><worldbody><body>
      <joint name="rail" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    </body></worldbody><actuator><motor name="motor" joint="rail"/></actuator></mujoco>"""
    simulator = MujocoSimulator(slide).with_effect(DryFriction("rail", Parameter(0.0, 9.0, "N")))
    v = _roll(simulator, [1.0], torch.full((20,), -10.0), v=0.1)["qvel"][-1, 0]
    assert float(v) == pytest.approx(-9.0 * (0.02 - 0.1 / 11.0), abs=2.0 * 0.001)


def test_dry_friction_adds_to_the_models_own() -> None:
    own = SLIDE.replace('axis="1 0 0"', 'axis="1 0 0" frictionloss="1"')
    simulator = MujocoSimulator(own).with_effect(DryFriction("rail", Parameter(0.0, 9.0, "N")))
    for push, moves in ((2.9, False), (3.1, True)):
        v = float(_roll(simulator, [2.0], torch.full((200,), push))["qvel"][-1, 0])
        assert (v > 0.01) == moves


def test_an_effect_adds_to_a_freed_parameter_of_the_same_field() -> None:
    space = ParameterSpace({"joint.rail.damping": Parameter(0.0, 9.0)})
    both = MujocoSimulator(SLIDE, space).with_effect(ViscousFriction("rail", Parameter(0.0, 9.0)))
    alone = MujocoSimulator(SLIDE, space)
    command = torch.randn(50)
    assert torch.equal(_roll(both, [1.5, 2.5], command)["qpos"], _roll(alone, [4.0], command)["qpos"])


def test_two_springs_are_one() -> None:
    space = ParameterSpace({"joint.rail.stiffness": Parameter(0.0, 9.0), "joint.rail.springref": Parameter(-1.0, 1.0)})
    spring = JointStiffness("rail", Parameter(0.0, 9.0), Parameter(-1.0, 1.0))
    both = MujocoSimulator(SLIDE, space).with_effect(spring)
    alone = MujocoSimulator(SLIDE, space)
    command = torch.randn(200)
    a = _roll(both, [2.0, -0.5, 3.0, 0.5], command)["qpos"]
    assert torch.allclose(a, _roll(alone, [5.0, 0.1], command)["qpos"], rtol=0, atol=1e-13)
    with pytest.raises(BadInput, match="nonlinear"):
        MujocoSimulator(SLIDE.replace('axis="1 0 0"', 'axis="1 0 0" stiffness="1 2 0"')).with_effect(spring)


def test_gain_scales_the_force_of_motor_and_servo() -> None:
    motor = MujocoSimulator(SLIDE).with_effect(ActuatorGain("motor", Parameter(-0.5, 1.0)))
    assert float(_roll(motor, [0.5], torch.ones(10))["qvel"][-1, 0]) == pytest.approx(1.5 * 10 * H / MASS)
    servo = SLIDE.replace("<motor ", '<position kp="%s" kv="%s" ')
    scaled = MujocoSimulator(servo % (4, 1)).with_effect(ActuatorGain("motor", Parameter(-0.5, 1.0)))
    command = torch.randn(100)
    direct = _roll(MujocoSimulator(servo % (5, 1.25)), [], command)["qpos"]
    assert torch.allclose(_roll(scaled, [0.25], command)["qpos"], direct, rtol=0, atol=1e-14)
    muscle = SLIDE.replace("<motor ", '<muscle lengthrange="0.1 1" ')
    with pytest.raises(BadInput, match="not linear"):
        MujocoSimulator(muscle).with_effect(ActuatorGain("motor", Parameter(-0.5, 1.0)))


@pytest.mark.parametrize("delay", [0.0, 0.0005, 0.002, 0.0033, 0.006, 0.0137, 0.02])
def test_a_delay_moves_the_impulse_by_exactly_its_time(delay: float) -> None:
    # Over a staircase of forces the velocity gained up to t is the integral of u(s - T) up to t.
    simulator = MujocoSimulator(SLIDE).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.02, "s")))
    command = torch.randn(40, dtype=torch.float64)
    path = _roll(simulator, [delay], command)
    edges = H * torch.arange(41, dtype=torch.float64)
    gained = torch.cat([torch.zeros(1, dtype=torch.float64), command.cumsum(0) * H])
    for k in range(1, 41):
        t = float(edges[k]) - delay
        j = min(max(math.floor(t / H), 0), 39)
        expected = 0.0 if t <= 0 else float(gained[j] + command[j] * (t - j * H))
        assert float(path["qvel"][k - 1, 0]) == pytest.approx(expected / MASS, abs=1e-14)


def test_a_delays_hidden_state_is_the_past_commands() -> None:
    effect = ActuatorDelay("motor", Parameter(0.0, 0.007, "s"))
    simulator = MujocoSimulator(SLIDE, worlds=1).with_effect(effect)
    path = _roll(simulator, [0.004], torch.arange(1.0, 7.0))
    past = path["effects", effect.key, "past"]
    assert past.shape == (6, effect.length(H))
    assert effect.length(H) == 5
    assert past[0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0]
    assert past[-1].tolist() == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert float(path["qvel"][2, 0]) == pytest.approx(H / MASS)


def test_a_trace_is_what_the_steps_would_leave() -> None:
    effect = ActuatorDelay("motor", Parameter(0.0, 0.01, "s"))
    own, command = {"delay": torch.tensor([0.003, 0.0]).double()}, torch.randn(2, 7, dtype=torch.float64)
    start = effect.rest(2, H, command)
    start["past"].normal_()
    views = effect.trace(own, start, command, H)
    walked = Effect.trace(effect, own, start, command, H)
    assert views is not None
    assert torch.equal(views["past"], walked["past"])
    assert torch.equal(views["past"][:, -1], effect.command(own, start, command, H)[1]["past"])


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: ViscousFriction("j", Parameter(-1.0, 1.0)), "never negative"),
        (lambda: DryFriction("j", Parameter(-1.0, 1.0)), "never negative"),
        (lambda: QuadraticDrag("j", Parameter(-1.0, 1.0)), "never negative"),
        (lambda: JointStiffness("j", Parameter(-1.0, 1.0), Parameter(-1.0, 1.0)), "never negative"),
        (lambda: ActuatorDelay("j", Parameter(-1.0, 1.0)), "never negative"),
        (lambda: ActuatorGain("j", Parameter(-1.0, 1.0)), "dead"),
    ],
)
def test_bounds_without_physical_sense_are_refused(make, says: str) -> None:
    with pytest.raises(BadInput, match=says):
        make()


def test_targets_that_cannot_carry_an_effect_are_refused() -> None:
    tumbler = ARM.replace('<joint name="shoulder" axis="0 1 0"', '<joint name="shoulder" type="ball"')
    tumbler = tumbler.replace('range="-150 150"', "").replace('<joint joint="shoulder" coef="1"/>', "")
    with pytest.raises(BadInput, match="free or ball"):
        MujocoSimulator(tumbler).with_effect(ViscousFriction("shoulder", Parameter(0.0, 1.0)))
    with pytest.raises(BadInput, match="nearest: elbow"):
        MujocoSimulator(ARM).with_effect(ViscousFriction("elbo", Parameter(0.0, 1.0)))
    with pytest.raises(BadInput, match="nearest: bend"):
        MujocoSimulator(ARM).with_effect(ActuatorDelay("bnd", Parameter(0.0, 1.0)))
