"""Effects that act between the engine's timesteps: their laws, one physics on two backends, hidden states, limits."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import ClassVar

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators import Joint, Simulator, TorchSimulator
from onlinebayes.simulators.effects import (
    ActuatorLag,
    Cogging,
    DryFriction,
    Effect,
    LoadDependentFriction,
    Scales,
    StribeckFriction,
    ThermalDerating,
)
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.stage import Place
from onlinebayes.simulators.mujoco.system import MujocoSystem
from onlinebayes.simulators.stepping import Actuator
from tests.simulators.models import ARM, SLIDE

H, MASS = 0.002, 2.0
SCALES = Scales(force=8.0, speed=2.0, travel=2.0, time=0.05, unit="slide")
Law = Callable[[float, float, float, float], tuple[float, float, float]]


class Slider(TorchSimulator):
    """The slide of ``models.SLIDE`` in torch."""

    physical = ParameterSpace({})
    defaults: ClassVar = {}
    joints = (Joint("rail", "slide"),)
    actuators = (Actuator("motor", "rail"),)
    timestep = H

    def acceleration(self, parameters, q, v, tau):
        return tau / MASS


# effect, truth, and its law: (q, v, f, hidden) -> force, bound of dry friction, d hidden / dt.
CASES: list[tuple[Effect, list[float], Law]] = [
    (
        StribeckFriction.scaled("rail", SCALES),
        [1.5, 2.5, 0.3],
        lambda q, v, f, h: (0.0, 1.5 + math.exp(-((v / 0.3) ** 2)), 0.0),
    ),
    (LoadDependentFriction.scaled("rail", SCALES), [0.3], lambda q, v, f, h: (0.0, 0.3 * abs(f), 0.0)),
    (
        Cogging.scaled("rail", SCALES),
        [2.0, 9.0, 0.7],
        lambda q, v, f, h: (2.0 * math.sin(9.0 * q + 0.7), 0.0, 0.0),
    ),
    (
        ThermalDerating("motor", Parameter(0, 2), Parameter(0.05, 5, "s", scale="log"), 4.0),
        [0.8, 0.4],
        lambda q, v, f, h: (f / (1 + 0.8 * h) - f, 0.0, ((f / 4.0) ** 2 - h) / 0.4),
    ),
]


def _backend(kind: str, effect: Effect) -> Simulator:
    return (MujocoSimulator(SLIDE) if kind == "mujoco" else Slider()).with_effect(effect)


def _command(steps: int) -> np.ndarray:
    t = H * np.arange(steps)
    return 5.0 * np.sin(7.0 * t) + 3.0 * np.sign(np.sin(2.1 * t + 0.5))


def _independent(law: Law, command: np.ndarray, fine: int = 20) -> np.ndarray:
    """Positions after each timestep by the trapezium of velocities at a ``fine``-th of it; a stop is met exactly."""
    q, v, hidden, dt, path = 0.0, 0.0, 0.0, H / fine, []
    for f in command:
        for _ in range(fine):
            force, bound, rate = law(q, v, f, hidden)
            free = v + dt * (f + force) / MASS
            brake = dt * bound / MASS
            old, v = v, 0.0 if abs(free) <= brake else free - math.copysign(brake, free)
            q, hidden = q + dt * (old + v) / 2, hidden + dt * rate
        path.append(q)
    return np.array(path)


def _roll(simulator: Simulator, theta: torch.Tensor, command: np.ndarray, start: TensorDict | None = None):
    rows, steps = len(theta), len(command)
    state = TensorDict({k: torch.zeros(rows, 1).double() for k in ("qpos", "qvel")}, batch_size=[rows])
    u = torch.from_numpy(command).reshape(1, steps, 1).expand(rows, -1, -1).contiguous()
    times = H * torch.arange(1, steps + 1, dtype=torch.float64)
    inputs = TensorDict({"command": u}, batch_size=[rows, steps])
    return simulator.rollout(theta, state if start is None else start, inputs, times)


@pytest.mark.parametrize("case", [0, 2], ids=["stribeck_friction", "cogging"])
def test_forces_leave_runge_kuttas_method_an_error_of_second_order(case: int) -> None:
    effect, truth, _ = CASES[case]
    times = 0.02 * torch.arange(1, 21, dtype=torch.float64)
    command = torch.sin(7.0 * times - 0.14).reshape(1, 20, 1) * 5.0
    state = TensorDict({"qpos": torch.zeros(1, 1).double(), "qvel": torch.full((1, 1), 0.6).double()}, batch_size=[1])
    inputs = TensorDict({"command": command}, batch_size=[1, 20])
    model = MujocoSimulator(SLIDE).with_runge_kutta().with_effect(effect)

    def path(step: float) -> torch.Tensor:
        return model.with_timestep(step).rollout(torch.tensor([truth]).double(), state, inputs, times)["qpos"]

    fine = path(0.02 / 64)
    errors = [float((path(0.02 / parts) - fine).abs().max()) for parts in (2, 4, 8)]
    # Of first order an error halves with the step; of second it falls to a quarter.
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2] > 0.0, errors


def _recovered(simulator: Simulator, begin: torch.Tensor, command: np.ndarray, data: np.ndarray) -> torch.Tensor:
    """Least squares by Gauss and Newton, damped, with differences in one rollout an iteration."""
    space, theta, target = simulator.parameters, begin, torch.from_numpy(data)
    for _ in range(6):
        steps = 1e-4 * (space.high - space.low)
        tried = torch.cat([theta[None], theta + torch.diag(steps)])
        paths = _roll(simulator, tried, command)["qpos"][..., 0]
        jacobian = ((paths[1:] - paths[0]) / steps[:, None]).T
        step = torch.linalg.lstsq(jacobian, (target - paths[0])[:, None]).solution[:, 0]
        shares = torch.tensor([1.0, 0.5, 0.2, 0.05], dtype=torch.float64)
        options = space.clamp(theta + shares[:, None] * step)
        errors = (_roll(simulator, options, command)["qpos"][..., 0] - target).square().sum(1)
        theta = options[int(errors.argmin())]
    return theta


@pytest.mark.slow
@pytest.mark.parametrize(("effect", "truth", "law"), CASES, ids=[case[0].name for case in CASES])
def test_parameters_are_recovered_from_an_independent_integrator(effect: Effect, truth: list[float], law: Law) -> None:
    command = _command(400)
    # Runge and Kutta's method is exact for a force that is held, so that what is left is the holding.
    smooth = SLIDE.replace('timestep="0.002"', 'timestep="0.002" integrator="RK4"')
    simulator = MujocoSimulator(smooth).with_effect(effect)
    true = torch.tensor(truth, dtype=torch.float64)
    found = _recovered(simulator, true * 1.05, command, _independent(law, command))
    # A force held over a timestep of 2 ms against one of 100 us: two hundredths.
    torch.testing.assert_close(found, true, rtol=0.02, atol=0.0)


@pytest.mark.parametrize(("effect", "truth", "law"), CASES, ids=[case[0].name for case in CASES])
def test_both_backends_compute_one_physics(effect: Effect, truth: list[float], law: Law) -> None:
    command, theta = _command(300), torch.tensor([truth], dtype=torch.float64)
    ours, theirs = (_roll(_backend(kind, effect), theta, command) for kind in ("mujoco", "torch"))
    # Forces alone agree to rounding; MuJoCo's friction is softer by its impedance, 1e-4, at each change of sign.
    atol = 2e-4 if effect.bounds_friction else 1e-12
    torch.testing.assert_close(ours["qpos"], theirs["qpos"], rtol=0.0, atol=atol)
    if effect.memory:
        heat = ("effects", effect.key, "heat")
        torch.testing.assert_close(ours[heat], theirs[heat], rtol=0.0, atol=1e-12)
        assert float(ours[heat].max()) > 0.5


@pytest.mark.parametrize("backend", ["mujoco", "torch"])
def test_hidden_state_is_carried_across_a_split_rollout(backend: str) -> None:
    effect, truth, _ = CASES[-1]
    simulator, command = _backend(backend, effect), _command(200)
    theta = torch.tensor([truth], dtype=torch.float64)
    whole = _roll(simulator, theta, command)
    first = _roll(simulator, theta, command[:100])
    second = _roll(simulator, theta, command[100:], first[:, -1].exclude("valid").clone())
    for key in ("qpos", "qvel", ("effects", effect.key, "heat")):
        assert torch.equal(torch.cat([first[key], second[key]], dim=1), whole[key])


@pytest.mark.parametrize("backend", ["mujoco", "torch"])
def test_heat_recalled_along_a_motion_is_that_of_the_simulation(backend: str) -> None:
    effect, _, _ = CASES[-1]
    lag = ActuatorLag("motor", Parameter(0, 0.1, "s"))
    simulator = _backend(backend, effect).with_effect(lag)
    theta = torch.tensor([[0.8, 0.4, 0.05], [0.3, 2.0, 0.0]]).double()
    command = _command(301)
    command[0] = 0.0  # the lag begins settled
    state = TensorDict({k: torch.zeros(2, 1).double() for k in ("qpos", "qvel")}, batch_size=[2])
    inputs = TensorDict({"command": torch.from_numpy(command).reshape(1, -1, 1).expand(2, -1, -1)}, batch_size=[2, 301])
    inputs["enable"] = torch.ones(2, 301, 1, dtype=torch.float64)
    inputs["enable"][1, 100:180] = 0.0
    times = H * torch.arange(1, 302, dtype=torch.float64)
    path = simulator.rollout(theta, state, inputs, times)
    before = TensorDict.cat([state[:, None], path.select("qpos", "qvel")[:, :-1]], dim=1)
    heat = simulator.hidden_states_along(theta, before.update(inputs), H)[effect.key]["heat"]
    assert heat.shape == (2, 302)
    assert float(heat[0].max()) > 0.5
    torch.testing.assert_close(heat[:, 1:], path["effects", effect.key, "heat"], rtol=0.0, atol=1e-12)


def test_the_recalled_drive_of_a_servo_depends_on_the_motion() -> None:
    model = SLIDE.replace('<motor name="motor" joint="rail"/>', '<position name="motor" joint="rail" kp="50" kv="4"/>')
    effect, truth, _ = CASES[-1]
    simulator, theta = MujocoSimulator(model).with_effect(effect), torch.tensor([truth]).double()
    path = _roll(simulator, theta, _command(300) / 20)
    zero = torch.zeros(1, 1, 1).double()
    motion = TensorDict(
        {key: torch.cat([zero, path[key][:, :-1]], dim=1) for key in ("qpos", "qvel")}, batch_size=[1, 300]
    )
    motion["command"] = torch.from_numpy(_command(300) / 20).reshape(1, -1, 1)
    heat = simulator.hidden_states_along(theta, motion, H)[effect.key]["heat"]
    torch.testing.assert_close(heat[:, 1:], path["effects", effect.key, "heat"], rtol=0.0, atol=1e-12)
    assert float(heat.max()) > 0.1


class Fading(Effect):
    """A drag that remembers the speed, walked row by row."""

    name = "fading"
    target_kind = "joint"
    target = "rail"
    parameters = ParameterSpace({"drag": Parameter(0.0, 1.0)})
    neutral: ClassVar = {"drag": 0.0}
    memory = 1.0

    @classmethod
    def scaled(cls, target: str, scales: Scales) -> Fading:
        return cls()

    def rest(self, worlds: int, timestep: float, like: torch.Tensor) -> TensorDict:
        return TensorDict({"speed": torch.zeros(worlds).double()}, batch_size=[worlds])

    def force(self, parameters, seen):
        return -parameters["drag"] * seen.hidden["speed"]

    def advance(self, parameters, seen):
        speed = seen.hidden["speed"] + seen.timestep * (seen.v - seen.hidden["speed"])
        return TensorDict({"speed": speed}, batch_size=speed.shape)


@pytest.mark.parametrize("backend", ["mujoco", "torch"])
def test_an_effect_without_a_form_of_its_own_is_recalled_row_by_row(backend: str) -> None:
    effect = Fading()
    simulator, theta = _backend(backend, effect), torch.tensor([[0.5], [0.9]]).double()
    path = _roll(simulator, theta, _command(60))
    zero = torch.zeros(2, 1, 1).double()
    motion = TensorDict(
        {key: torch.cat([zero, path[key][:, :-1]], dim=1) for key in ("qpos", "qvel")}, batch_size=[2, 60]
    )
    motion["command"] = torch.from_numpy(_command(60)).reshape(1, -1, 1).expand(2, -1, -1)
    speed = simulator.hidden_states_along(theta, motion, H)[effect.key]["speed"]
    assert float(speed.abs().max()) > 1e-3
    torch.testing.assert_close(speed[:, 1:], path["effects", effect.key, "speed"], rtol=0.0, atol=1e-12)


def test_friction_sticks_and_breaks_loose_at_the_static_bound() -> None:
    effect = StribeckFriction.scaled("rail", SCALES)
    simulator, theta = MujocoSimulator(SLIDE).with_effect(effect), torch.tensor([[1.0, 3.0, 0.1]]).double()
    held = _roll(simulator, theta, np.full(500, 2.7))
    assert float(held["qvel"].abs().max()) < 1e-6
    loose = _roll(simulator, theta, np.full(500, 3.3))
    # Once fast the sliding friction is left: (3.3 - 1) / 2 kg.
    gained = (loose["qvel"][0, -1, 0] - loose["qvel"][0, -101, 0]) / (100 * H)
    assert float(gained) == pytest.approx((3.3 - 1.0) / MASS, rel=1e-3)


def test_staged_friction_adds_to_the_models_and_to_dry_friction() -> None:
    model = SLIDE.replace('type="slide"', 'type="slide" frictionloss="0.5"')
    simulator = MujocoSimulator(model).with_effect(DryFriction("rail", Parameter(0, 5, "N")))
    simulator = simulator.with_effect(LoadDependentFriction("rail", Parameter(0, 1)))
    path = _roll(simulator, torch.tensor([[0.7, 0.25]]).double(), np.full(400, 4.0))
    gained = (path["qvel"][0, -1, 0] - path["qvel"][0, 199, 0]) / (200 * H)
    assert float(gained) == pytest.approx((4.0 - 0.5 - 0.7 - 0.25 * 4.0) / MASS, rel=1e-3)


def test_the_drive_is_the_engines_own() -> None:
    # Motor with limits and gear, servo with limits of force: what the next timestep will compute.
    effects = (LoadDependentFriction("shoulder", Parameter(0, 1)), LoadDependentFriction("elbow", Parameter(0, 1)))
    system = MujocoSystem(mujoco.MjSpec.from_string(ARM), ParameterSpace({}), effects)
    data = mujoco.MjData(system.model)
    fields = {
        name: torch.from_numpy(getattr(system.model, name)[None].copy())
        for name in ("actuator_gear", "actuator_gainprm", "actuator_biasprm", "actuator_ctrlrange")
    }
    fields["actuator_forcerange"] = torch.from_numpy(system.model.actuator_forcerange[None].copy())
    rng = np.random.default_rng(0)
    for _ in range(20):
        data.qpos[:], data.qvel[:], data.ctrl[:] = rng.normal(size=(3, 2)) * [[0.5], [2.0], [1.5]]
        mujoco.mj_forward(system.model, data)
        for effect in effects:
            place = Place.of(system, effect)
            q, v = torch.tensor([data.qpos[place.q]]), torch.tensor([data.qvel[place.v]])
            ctrl, on = torch.from_numpy(data.ctrl[None].copy()), torch.ones(1, 2, dtype=torch.bool)
            force = sum(a.force(fields, ctrl, q, v, on) * a.gear(fields) for a in place.actuators)
            assert float(force) == pytest.approx(data.qfrc_actuator[place.v], rel=1e-12, abs=1e-12)


def test_a_motor_that_is_off_neither_heats_nor_loads() -> None:
    effect, truth, _ = CASES[-1]
    for backend in ("mujoco", "torch"):
        simulator = _backend(backend, effect)
        inputs = TensorDict({"command": torch.full((1, 50, 1), 4.0).double()}, batch_size=[1, 50])
        inputs["enable"] = torch.zeros(1, 50, 1, dtype=torch.float64)
        state = TensorDict({k: torch.zeros(1, 1).double() for k in ("qpos", "qvel")}, batch_size=[1])
        times = H * torch.arange(1, 51, dtype=torch.float64)
        path = simulator.rollout(torch.tensor([truth]).double(), state, inputs, times)
        assert float(path["qpos"].abs().max()) == 0.0
        assert float(path["effects", effect.key, "heat"].abs().max()) == 0.0


def test_a_force_that_the_equation_cannot_tell_is_refused() -> None:
    lag = SLIDE.replace(
        '<motor name="motor" joint="rail"/>',
        '<general name="motor" joint="rail" dyntype="filter" dynprm="0.1"/>',
    )
    with pytest.raises(BadInput, match="not linear in command and motion"):
        MujocoSimulator(lag).with_effect(ThermalDerating.scaled("motor", SCALES))
    MujocoSimulator(lag).with_effect(Cogging.scaled("rail", SCALES))  # does not ask for the force


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: StribeckFriction("rail", Parameter(-1, 1), Parameter(0, 1), Parameter(0.1, 1)), "never negative"),
        (lambda: StribeckFriction("rail", Parameter(0, 1), Parameter(0, 1), Parameter(0, 1)), "stay above 0"),
        (lambda: LoadDependentFriction("rail", Parameter(-0.1, 1)), "never negative"),
        (lambda: Cogging("rail", Parameter(-1, 1), Parameter(1, 2), Parameter(0, 1)), "never negative"),
        (lambda: ThermalDerating("motor", Parameter(0, 1), Parameter(0, 1)), "stay above 0"),
    ],
)
def test_bounds_that_are_not_physical_are_refused(make: Callable[[], Effect], match: str) -> None:
    with pytest.raises(BadInput, match=match):
        make()
