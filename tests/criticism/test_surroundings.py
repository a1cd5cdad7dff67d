"""Air, wind, contacts and play named from logs that equations of their own have made; slow, for each is a search."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from onlinebayes.criticism import Criticism, Selection, refine
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator
from tests.simulators import test_air_effects, test_contact_effects

STEP = 0.01


def _table(
    path: np.ndarray, joints: list[str], noise: float, seed: int, **commands: np.ndarray
) -> dict[str, np.ndarray]:
    """One run: positions (T, J) every STEP seconds, read by a noisy sensor, and the commands."""
    read = path + noise * np.random.default_rng(seed).normal(size=path.shape)
    columns = {f"qpos.{joint}": read[:, j] for j, joint in enumerate(joints)}
    return {"time": STEP * np.arange(len(path)), **{f"ctrl.{name}": u for name, u in commands.items()}, **columns}


def _judged(
    model: str,
    free: dict[str, Parameter],
    runs: list[dict],
    noise: float,
    unit: str,
    candidates: list[str],
    horizon: float = 1.0,
) -> Criticism:
    joints = [name for name in runs[0] if name.startswith("qpos.")]
    commands = [name.removeprefix("ctrl.") for name in runs[0] if name.startswith("ctrl.")]
    measured = Measurement.from_runs(
        {f"run{r}": run for r, run in enumerate(runs)},
        signals=[Signal(name, unit, sd=noise) for name in joints],
        commands=commands,
    )
    simulator = MujocoSimulator(model, ParameterSpace(free), threads=1)
    return refine(simulator, measured, candidates=candidates, selection=Selection(horizon_s=horizon))


@pytest.mark.slow
def test_air_drag_of_a_thrown_ball() -> None:
    drag, mass, noise, runs = 0.05, test_air_effects.MASS, 1e-4, []
    for r in range(12):
        start = [0.0, 8.0 - 1.3 * r]
        path = solve_ivp(
            lambda _, y: [y[1], -9.81 - drag / mass * abs(y[1]) * y[1]],
            (0, 2.0),
            start,
            t_eval=STEP * np.arange(201),
            rtol=1e-10,
            atol=1e-10,
        )
        runs.append(_table(path.y[:1].T, ["fall"], noise, r))
    free = {"joint.fall.damping": Parameter(0.0, 0.5, "N s/m")}
    model = test_air_effects.DROP.replace("0 0 -20", "0 0 -90")
    result = _judged(model, free, runs, noise, "m", ["air_drag", "constant_load", "dry_friction", "payload"])
    assert result.accepted == ("air_drag@ball",)
    assert result.parameters["air_drag@ball.drag"].mean == pytest.approx(drag, rel=0.02)
    assert result.remainder.status == "noise"


@pytest.mark.long
def test_wind_on_a_pendulum() -> None:
    length, drag, wind, mass, noise, runs = 0.6, 0.02, 4.0, test_air_effects.MASS, 1e-4, []
    inertia = mass * length**2 + 1e-5

    def rate(_: float, y: np.ndarray) -> list[float]:
        along = -length * np.array([math.cos(y[0]), -math.sin(y[0])])
        u = along * y[1] - [wind, 0]
        return [y[1], (along @ (-drag * np.linalg.norm(u) * u - [0, mass * 9.81]) - 0.005 * y[1]) / inertia]

    for r in range(9):
        start = [0.3 * r - 1.2, 2.0 - r]
        path = solve_ivp(rate, (0, 3.0), start, t_eval=STEP * np.arange(301), rtol=1e-10, atol=1e-10)
        runs.append(_table(path.y[:1].T, ["hinge"], noise, r))
    free = {"joint.hinge.damping": Parameter(0.0, 0.1, "N m s/rad")}
    names = ["wind", "air_drag", "constant_load", "dry_friction", "joint_stiffness"]
    result = _judged(test_air_effects.PENDULUM, free, runs, noise, "rad", names)
    assert result.accepted == ("wind@bob.x",)
    assert result.parameters["wind@bob.x.velocity"].mean == pytest.approx(wind, rel=0.1)
    assert result.remainder.status == "noise"


@pytest.mark.long
def test_a_slippery_foot() -> None:
    mu, mass, noise, runs = 0.3, 2.0, 1e-4, []
    for r in range(9):
        t = STEP * np.arange(301)
        u = 22.0 * np.sin((2.1 + 0.3 * r) * t + r)
        v = q = 0.0
        path = [q]
        for force in u[:-1]:
            for _ in range(100):
                h = STEP / 100
                free = v + h * force / mass
                v = math.copysign(max(abs(free) - h * mu * 9.81, 0.0), free)
                q += h * v
            path.append(q)
        runs.append(_table(np.array([path, np.zeros(301)]).T, ["x", "z"], noise, r, push=u))
    model = test_contact_effects.SLEDGE.replace(' pos="0 0 .1"', ' pos="0 0 .09999"')
    free = {"joint.x.damping": Parameter(0.0, 20.0, "N s/m")}
    names = ["contact_friction", "dry_friction@x", "quadratic_drag@x", "constant_load@x"]
    result = _judged(model, free, runs, noise, "m", names)
    assert result.accepted == ("contact_friction@runner",)
    assert result.parameters["contact_friction@runner.friction"].mean == pytest.approx(mu, rel=0.03)


@pytest.mark.long
def test_a_soft_floor() -> None:
    # In contact the acceleration is (1 - d) times the free one and d times that of the spring.
    T, ratio, d, mass, noise, runs = 0.08, 0.3, 0.9, 2.0, 1e-6, []
    b, k = 2 / (d * T), d / (d * T * ratio) ** 2
    for r in range(9):
        u = -60.0 + 8.0 * np.sin(STEP * (12.0 + 3 * r) * np.arange(201))

        def rate(t: float, y: np.ndarray, u: np.ndarray = u) -> list[float]:
            free = u[min(int(t / STEP + 1e-9), 200)] / mass - 9.81
            return [y[1], (1 - d) * free + d * (-b * y[1] - k * y[0])]

        times = STEP * np.arange(201)
        path = solve_ivp(rate, (0, 2.0), [-0.003, 0.0], t_eval=times, max_step=STEP / 4, rtol=1e-10, atol=1e-12).y[:1]
        runs.append(_table(path.T, ["z"], noise, r, push=u))
    free = {"joint.z.damping": Parameter(0.0, 20.0, "N s/m")}
    names = ["contact_softness", "dry_friction", "joint_stiffness", "viscous_friction"]
    result = _judged(test_contact_effects.BALL, free, runs, noise, "m", names, horizon=0.3)
    assert result.accepted == ("contact_softness@ball",)
    # Along T zeta = const the stiffness stays, and a fit advances slowly there: what is found is the stiffness.
    time, damping = (result.parameters[f"contact_softness@ball.{n}"].mean for n in ("time_constant", "damping_ratio"))
    assert time * damping == pytest.approx(T * ratio, rel=0.02)
