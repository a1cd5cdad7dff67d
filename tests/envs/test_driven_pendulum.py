"""The rig: its integrator against others, true stick, an exact delay; its MJCF; the sets it hands over; its task."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from tensordict import TensorDict
from torchrl.envs.utils import check_env_specs

from envs.driven_pendulum import KINDS, MODEL, BalanceTask, DrivenPendulumRig, Protocol, blind_set, blind_sets, record
from envs.driven_pendulum.dynamics import BOB_INERTIA, GRAVITY, LENGTH
from envs.driven_pendulum.rig import (
    DAMPING,
    DELAY,
    DRAG,
    FRICTION,
    MASS,
    NOMINAL,
    PARAMETERS,
    SPRINGREF,
    STIFFNESS,
)
from envs.driven_pendulum.sets import SIZES, drive
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import DryFriction
from onlinebayes.simulators.env import SimulatorEnv
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_simulator

SHORT = Protocol(fit=3, held=1, seconds=0.5)


def theta(**values: float) -> torch.Tensor:
    names = {"friction": FRICTION, "drag": DRAG, "stiffness": STIFFNESS, "springref": SPRINGREF, "delay": DELAY}
    names |= {"mass": MASS, "damping": DAMPING}
    return PARAMETERS.vector({**NOMINAL, **{names[key]: value for key, value in values.items()}})[None]


def commands(rows: int, scale: float = 0.6) -> torch.Tensor:
    return scale * torch.randn(1, rows, dtype=torch.float64).repeat_interleave(10, 1)[:, :rows]


def angles(rig: DrivenPendulumRig, parameters: torch.Tensor, u: torch.Tensor, period: float = 0.005) -> torch.Tensor:
    """From rest; row k after the k-th command."""
    times = torch.arange(u.shape[1] + 1, dtype=torch.float64) * period
    return drive(rig, parameters, times, torch.cat([u, u[:, -1:]], 1))[:, 1:]


def test_keeps_the_contract_of_simulators() -> None:
    check_simulator(DrivenPendulumRig(2), atol=1e-12)


@pytest.mark.parametrize(
    "values",
    [{}, {"drag": 0.004}, {"stiffness": 0.8, "springref": 0.4}, {"mass": 0.25, "damping": 0.05, "drag": 0.01}],
)
def test_smooth_motion_equals_scipys_integrator(values: dict[str, float]) -> None:
    u, parameters = commands(200), theta(**values)
    p = dict(zip(PARAMETERS, parameters[0].tolist(), strict=True))
    inertia = p[MASS] * LENGTH**2 + BOB_INERTIA

    def motion(t: float, y: np.ndarray, torque: float) -> list[float]:
        q, v = y
        total = torque - p[MASS] * GRAVITY * LENGTH * math.sin(q) - p[DAMPING] * v - p[DRAG] * v * abs(v)
        return [v, (total - p[STIFFNESS] * (q - p[SPRINGREF])) / inertia]

    y, expected = np.zeros(2), []
    for torque in u[0].tolist():
        y = solve_ivp(motion, (0, 0.005), y, "DOP853", args=(torque,), rtol=1e-11, atol=1e-13).y[:, -1]
        expected.append(y[0])
    found = angles(DrivenPendulumRig(), parameters, u)[0]
    torch.testing.assert_close(found, torch.tensor(expected, dtype=torch.float64), rtol=0, atol=1e-7)


def test_dry_friction_equals_a_plain_integrator_with_tiny_steps() -> None:
    u, parameters = commands(100, 0.3), theta(friction=0.08, damping=0.0)
    h, q, v, expected = 2e-6, 0.0, 0.0, []
    mass, inertia = float(parameters[0, 0]), float(parameters[0, 0]) * LENGTH**2 + BOB_INERTIA
    for torque in u[0].tolist():
        for _ in range(round(0.005 / h)):
            # Implicit in the sign: the friction that stops it within the step, at most F.
            free = v + h * (torque - mass * GRAVITY * LENGTH * math.sin(q)) / inertia
            v = math.copysign(max(abs(free) - h * 0.08 / inertia, 0.0), free)
            q += h * v
        expected.append(q)
    found = angles(DrivenPendulumRig(), parameters, u)[0]
    torch.testing.assert_close(found, torch.tensor(expected, dtype=torch.float64), rtol=0, atol=2e-5)


def test_integration_error_is_far_below_the_encoder() -> None:
    u = commands(150, 0.4)
    parameters = theta(friction=0.03, drag=0.001, delay=0.0133, stiffness=0.05)
    coarse = angles(DrivenPendulumRig(), parameters, u)
    fine = angles(DrivenPendulumRig(timestep=0.0005), parameters, u)
    assert bool(coarse.abs().max() > 0.1)
    torch.testing.assert_close(coarse, fine, rtol=0, atol=1e-7)


def test_sticks_without_creep_below_breakaway_and_slips_above() -> None:
    rig = DrivenPendulumRig(2)
    rig.reset(theta(friction=0.1).expand(2, -1).clone())
    held = TensorDict({"command": torch.tensor([[0.0999], [0.1001]])}, batch_size=(2,))
    for _ in range(400):
        state = rig.step(held)
    assert float(state["qpos"][0]) == 0.0
    assert float(state["qvel"][0]) == 0.0
    assert float(state["qpos"][1]) > 1e-5


def test_a_swing_comes_to_rest_off_the_bottom_for_good() -> None:
    rig = DrivenPendulumRig(1)
    start = TensorDict({"qpos": torch.tensor([[0.5]]), "qvel": torch.zeros(1, 1)}, batch_size=(1,))
    rig.reset(theta(friction=0.1, damping=0.0), start)
    still = TensorDict({"command": torch.zeros(1, 1)}, batch_size=(1,))
    for _ in range(500):
        rest = rig.step(still)
    assert float(rest["qvel"]) == 0.0
    assert 0 < abs(float(rest["qpos"])) <= math.asin(0.1 / (0.4 * GRAVITY * LENGTH))
    assert torch.equal(rig.step(still)["qpos"], rest["qpos"])


def test_a_delay_of_whole_periods_is_a_shift() -> None:
    u = commands(200)
    late = torch.cat([torch.zeros(1, 4, dtype=u.dtype), u[:, :-4]], 1)
    rig = DrivenPendulumRig()
    torch.testing.assert_close(angles(rig, theta(delay=0.02), u), angles(rig, theta(), late), rtol=0, atol=1e-12)


def test_a_delay_is_continuous() -> None:
    u = commands(200)
    shifted = torch.cat([torch.zeros(1, 7, dtype=u.dtype), u.repeat_interleave(5, 1)[:, :-7]], 1)
    expected = angles(DrivenPendulumRig(dt=0.001, timestep=0.001), theta(), shifted, 0.001)[:, 4::5]
    found = angles(DrivenPendulumRig(), theta(delay=0.007), u)
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-7)


def test_the_model_file_has_the_same_nominal_mechanics() -> None:
    space = ParameterSpace({MASS: PARAMETERS[MASS], DAMPING: Parameter(0.0, 0.1, "N m s/rad")})
    model = MujocoSimulator(MODEL, space, dt=0.005)
    torch.testing.assert_close(model.nominal, theta()[0, :2])
    u = commands(300)
    times = torch.arange(1, 301, dtype=torch.float64) * 0.005
    inputs = TensorDict({"command": u[..., None]}, batch_size=(1, 300))
    for values in ({}, {"mass": 0.27, "damping": 0.03}):
        at_rest = TensorDict({}, batch_size=(1,))
        replay = model.rollout(theta(**values)[:, :2], model.state[:1], inputs, times)["qpos"][..., 0]
        rig = DrivenPendulumRig().rollout(theta(**values), at_rest, inputs, times)["qpos"][..., 0]
        torch.testing.assert_close(replay, rig, rtol=0, atol=1e-7)


def test_refuses_what_it_cannot_do() -> None:
    with pytest.raises(BadInput, match="whole number of timesteps"):
        DrivenPendulumRig(dt=0.005, timestep=0.003)
    with pytest.raises(BadInput, match="set one of its own parameters"):
        DrivenPendulumRig().with_effect(DryFriction("hinge", Parameter(0.0, 1.0, "N m")))
    with pytest.raises(BadInput, match="frictionloss"):
        DrivenPendulumRig().reset(theta(friction=-0.1))
    with pytest.raises(BadInput, match="stiction"):
        blind_set("stiction", 0)


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_sets_hide_one_effect_and_come_out_the_same_in_any_company(kind: str) -> None:
    made, *_ = blind_sets([(kind, 3), ("null", 4)], SHORT)
    alone = blind_set(kind, 3, SHORT)
    assert torch.equal(made.angle, alone.angle)
    assert torch.equal(made.command, alone.command)
    assert not torch.equal(made.angle, blind_set(kind, 4, SHORT).angle)
    hidden = [name for _, name, _, _ in SIZES.values() if made.truth[name] > 0]
    assert hidden == ([] if kind == "null" else [SIZES[kind][1]])
    assert made.hidden == (None if kind == "null" else SIZES[kind][0])
    assert made.truth[MASS] != NOMINAL[MASS]


def test_the_operator_waits_and_keeps_the_swing_and_the_encoder_rounds() -> None:
    made = blind_set("null", 0, Protocol(fit=10, held=2, seconds=2.0))
    assert made.holdout == made.runs[-2:]
    assert not made.command[:, :30].any()
    reach = made.angle.abs().amax(1)
    assert bool((reach > 0.2).all())
    assert bool((reach < 1.85).all())
    assert bool((made.angle.diff(dim=1).abs().amax(1) > 0.01).all())
    steps = made.angle / made.encoder.resolution
    torch.testing.assert_close(steps, steps.round(), rtol=0, atol=1e-6)
    # Bounds of 4 standard errors on 12 x 400 readings: false-failure rate below 1e-4.
    rig, times = DrivenPendulumRig(), made.times
    truth = PARAMETERS.vector(made.truth).expand(len(made.runs), -1)
    noise = made.angle - drive(rig, truth, times, made.command)
    assert float(noise.std()) == pytest.approx(made.encoder.floor, rel=4 / math.sqrt(2 * noise.numel()))
    assert abs(float(noise.mean())) < 4 * made.encoder.floor / math.sqrt(noise.numel())


def test_two_effects_are_named_together() -> None:
    (made,) = record([({**NOMINAL, FRICTION: 0.02, DELAY: 0.01}, 0)], SHORT)
    assert made.hidden == "dry_friction@hinge+actuator_delay@motor"


def test_the_table_holds_what_was_measured(tmp_path) -> None:
    made = blind_set("null", 1, SHORT)
    made.write(tmp_path / "set.csv")
    lines = (tmp_path / "set.csv").read_text().splitlines()
    assert lines[0] == "run,time,ctrl.motor,qpos.hinge"
    assert len(lines) == 1 + 4 * len(made.times)
    run, time, command, angle = lines[1 + len(made.times) + 7].split(",")
    assert run == "fit2"
    values = torch.tensor([float(time), float(command), float(angle)], dtype=torch.float64)
    wanted = torch.stack([made.times[7], made.command[1, 7], made.angle[1, 7]])
    torch.testing.assert_close(values, wanted, rtol=1e-6, atol=1e-8)


def test_the_task_is_an_environment_and_counts_steps_held() -> None:
    task = BalanceTask(seconds=0.4, angle=0.0, speed=0.0)
    env = SimulatorEnv(DrivenPendulumRig(3, dt=task.period), task)
    check_env_specs(env)
    held = env.rollout(task.horizon, lambda td: td.set("action", torch.zeros(3, 1)))
    assert held.shape == (3, task.horizon)
    assert float(held["next", "reward"].sum(1).min()) > 0.999 * task.horizon
    assert bool(held["next", "truncated"][:, -1].all())


def test_the_task_ends_when_the_bob_falls() -> None:
    task = BalanceTask()
    env = SimulatorEnv(DrivenPendulumRig(2, dt=task.period), task)
    fallen = env.rollout(task.horizon, lambda td: td.set("action", torch.ones(2, 1)), break_when_any_done=False)
    first = fallen["next", "done"][..., 0].long().argmax(1)
    assert bool((first < 30).all())
    assert bool(fallen["next", "terminated"].any(1).all())
    assert bool((fallen["next", "reward"] >= 0).all())
