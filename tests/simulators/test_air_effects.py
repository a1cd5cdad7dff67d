"""Air drag and wind: their law on slides, hinges and free bodies, recovered from integrations of their own."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import AirDrag, Effect, Scales, Wind
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_effect
from tests.simulators.models import ARM, TUMBLER

H, STEPS, MASS, G = 0.005, 200, 0.1, 9.81
DROP = f"""
<mujoco><option timestep="{H}" integrator="RK4"/><worldbody>
  <geom name="floor" type="plane" pos="0 0 -20" size="1 1 .1"/>
  <body name="ball"><joint name="fall" type="slide" axis="0 0 1"/><geom name="ball" size=".03" mass="{MASS}"/></body>
</worldbody></mujoco>"""
THROWN = DROP.replace('<joint name="fall" type="slide" axis="0 0 1"/>', '<freejoint name="fall"/>')
DRAG = Parameter(0.0, 0.2, "N s2/m2")
WIND = Parameter(-9.0, 9.0, "m/s")
PENDULUM = f"""
<mujoco><option timestep="{H}" integrator="RK4"/><worldbody>
  <body name="bob"><joint name="hinge" axis="0 1 0"/>
    <inertial pos="0 0 -.6" mass="{MASS}" diaginertia="1e-5 1e-5 1e-5"/>
</body></worldbody></mujoco>"""


def _thrown(drag: float, wind: tuple[float, float, float], velocity: tuple[float, float, float]) -> np.ndarray:
    """Positions (T, 3) of a point mass by an integrator of its own."""

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        u = y[3:] - np.array(wind)
        return np.concatenate([y[3:], -drag / MASS * np.linalg.norm(u) * u - [0, 0, G]])

    times = H * np.arange(1, STEPS + 1)
    found = solve_ivp(rate, (0, times[-1]), [0, 0, 0, *velocity], t_eval=times, rtol=1e-11, atol=1e-12)
    return found.y[:3].T


def _rolled(simulator: MujocoSimulator, theta: np.ndarray, velocity: tuple[float, ...]) -> np.ndarray:
    start = simulator.with_worlds(1).state
    start["qvel"][:, : len(velocity)] = torch.tensor(velocity, dtype=torch.float64)
    times = H * torch.arange(1, STEPS + 1, dtype=torch.float64)
    inputs = TensorDict({"command": torch.zeros(1, STEPS, 0)}, batch_size=[1, STEPS])
    return simulator.rollout(torch.from_numpy(theta)[None], start, inputs, times)["qpos"][0].numpy()


def _recovered(model: str, effect: Effect, path: np.ndarray, velocity: tuple[float, ...]) -> dict[str, float]:
    simulator = MujocoSimulator(model).with_effect(effect)
    low, high = simulator.parameters.low.numpy(), simulator.parameters.high.numpy()

    def wrong(u: np.ndarray) -> np.ndarray:
        found = _rolled(simulator, low + u * (high - low), velocity)
        return (found[:, : path.shape[1]] - path).ravel()

    found = least_squares(wrong, np.full(len(low), 0.6), bounds=(0, 1), xtol=1e-12, ftol=1e-12, diff_step=1e-5)
    return dict(zip(effect.parameters, (low + found.x * (high - low)).tolist(), strict=True))


def test_drag_of_a_falling_ball_is_recovered() -> None:
    path = _thrown(0.05, (0, 0, 0), (0, 0, 3.0))[:, 2:]
    assert _recovered(DROP, AirDrag("ball", DRAG), path, (3.0,)) == pytest.approx({"drag": 0.05}, rel=1e-6)


def test_drag_and_wind_of_a_thrown_ball_are_recovered() -> None:
    path, effect = _thrown(0.05, (3.0, -4.0, 0), (2.0, 0, 5.0)), Wind("ball", DRAG, velocity_x=WIND, velocity_y=WIND)
    truth = {"drag": 0.05, "velocity_x": 3.0, "velocity_y": -4.0}
    assert _recovered(THROWN, effect, path, (2.0, 0.0, 5.0)) == pytest.approx(truth, rel=1e-6)


def test_wind_on_a_pendulum_is_recovered() -> None:
    # The bob at angle q lies at -l (sin q, cos q) from the hinge, and moves with -l (cos q, -sin q) dq/dt.
    length, drag, wind = 0.6, 0.05, 4.0
    inertia = MASS * length**2 + 1e-5

    def rate(_: float, y: np.ndarray) -> list[float]:
        along = -length * np.array([math.cos(y[0]), -math.sin(y[0])])
        u = along * y[1] - [wind, 0]
        force = -drag * np.linalg.norm(u) * u
        return [y[1], (along @ (force - [0, MASS * G])) / inertia]

    times = H * np.arange(1, STEPS + 1)
    path = solve_ivp(rate, (0, times[-1]), [0, 2.0], t_eval=times, rtol=1e-11, atol=1e-12).y[:1].T
    found = _recovered(PENDULUM, Wind("bob.x", DRAG, WIND), path, (2.0,))
    assert found == pytest.approx({"drag": drag, "velocity": wind}, rel=1e-5)


def test_the_world_drags_bodies_by_the_square_of_their_size() -> None:
    two = DROP.replace("</worldbody>", '<body name="dot"><freejoint/><geom size=".01" mass="1"/></body></worldbody>')
    simulator = MujocoSimulator(two).with_effect(AirDrag("world", DRAG))
    drag = simulator.fields(np.array([[0.09]]))["geom_fluid"][0, :, 1]
    ball, dot = (float(drag[simulator.model.geom(f"air_drag@world[{k}]").id]) for k in (0, 1))
    assert dot / ball == pytest.approx(1 / 9)
    alone = MujocoSimulator(DROP).with_effect(AirDrag("ball", DRAG))
    assert ball == alone.fields(np.array([[0.09]]))["geom_fluid"][0].max()


def test_the_wind_blows_on_bodies_with_drag() -> None:
    both = MujocoSimulator(THROWN).with_effect(AirDrag("ball", DRAG)).with_effect(Wind("ball.x", DRAG, WIND))
    one = MujocoSimulator(THROWN).with_effect(Wind("ball.x", DRAG, WIND))
    path = _rolled(both, np.array([0.03, 0.02, 5.0]), (2.0, 1.0, 5.0))
    assert path == pytest.approx(_rolled(one, np.array([0.05, 5.0]), (2.0, 1.0, 5.0)), abs=1e-12)


@pytest.mark.parametrize("model", [ARM, TUMBLER], ids=["arm", "tumbler"])
@pytest.mark.parametrize("cls", [AirDrag, Wind], ids=lambda cls: cls.name)
def test_conformance_of_the_world(model: str, cls: type[Effect]) -> None:
    # The arm's falls from its start, the tumbler lands on the floor: the spheres touch nothing and weigh nothing.
    # At the speeds of a fall: ten times the weight at 1 m/s would stop either within a timestep.
    fast = Scales(force=1, speed=10, travel=1, time=1)
    check_effect(MujocoSimulator(model, dt=0.02 if model == TUMBLER else None), cls.scaled("world", fast))


def test_a_drag_moves_nothing_else() -> None:
    # Sideways, a free body's drag at its centre of mass turns nothing.
    path = _rolled(MujocoSimulator(THROWN).with_effect(AirDrag("ball", DRAG)), np.array([0.1]), (2.0, 0.0, 5.0))
    assert np.abs(path[:, 3:] - [1, 0, 0, 0]).max() < 1e-12
    assert (path[:, 1] == 0).all()


def test_a_neutral_drag_beside_another_changes_no_bit() -> None:
    # The density that the one sets also reaches the boxes of bodies whose own drag is zero.
    two = DROP.replace("</worldbody>", '<body name="dot"><freejoint/><geom size=".3" mass="1e-3"/></body></worldbody>')
    check_effect(MujocoSimulator(two).with_effect(AirDrag("ball", DRAG)), AirDrag("dot", DRAG))


def test_a_fluid_of_the_models_own_is_refused() -> None:
    wet = DROP.replace("<option ", '<option density="1.2" ')
    with pytest.raises(BadInput, match="a fluid of its own"):
        MujocoSimulator(wet).with_effect(AirDrag("ball", DRAG))
    with pytest.raises(BadInput, match=r"beside a free option\.density"):
        MujocoSimulator(DROP, ParameterSpace({"option.density": Parameter(0.0, 2.0)})).with_effect(
            AirDrag("ball", DRAG)
        )
    with pytest.raises(BadInput, match="does not fit the target"):
        Wind("ball.x", DRAG, velocity_y=WIND)
    with pytest.raises(BadInput, match="nearest: ball"):
        MujocoSimulator(DROP).with_effect(AirDrag("bell", DRAG))


def test_refined_models_keep_the_drag() -> None:
    simulator = MujocoSimulator(THROWN).with_effect(Wind("ball.x", DRAG, WIND))
    theta = torch.tensor([0.05, 5.0], dtype=torch.float64)
    assert simulator.not_exportable(theta) == {}
    plain = MujocoSimulator(simulator.export_xml(theta))
    here = _rolled(simulator, theta.numpy(), (2.0, 1.0, 5.0))
    assert _rolled(plain, np.zeros(0), (2.0, 1.0, 5.0)) == pytest.approx(here, abs=1e-12)
