"""Effects on contacts: coefficients and compliances recovered from Coulomb's law and MuJoCo's documented spring."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares, minimize_scalar
from tensordict import TensorDict

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import Contact, ContactFriction, ContactSoftness, Effect, Scales
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.mujoco.native.contacts import contacts
from onlinebayes.simulators.testing import check_effect
from tests.simulators.models import ARM

H, G = 0.001, 9.81
SLEDGE = f"""
<mujoco><option timestep="{H}" cone="elliptic" impratio="100"/><worldbody>
  <geom name="floor" type="plane" size="9 9 .1" friction=".8"/>
  <body name="sledge" pos="0 0 .1">
    <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
    <geom name="runner" type="sphere" size=".1" mass="2" friction=".3"/>
  </body>
</worldbody><actuator><motor name="push" joint="x"/></actuator></mujoco>"""
"""It cannot turn, so that it slides on one point."""
BALL = f"""
<mujoco><option timestep="{H}" integrator="RK4"/><worldbody>
  <geom name="floor" type="plane" size="9 9 .1" solimp=".9 .9 .001"/>
  <body name="ball" pos="0 0 .1"><joint name="z" type="slide" axis="0 0 1"/>
    <geom name="ball" size=".1" mass="2" condim="1" solimp=".9 .9 .001"/></body>
</worldbody><actuator><motor name="push" joint="z"/></actuator></mujoco>"""


def _rolled(
    simulator: MujocoSimulator, theta: list[float], command: np.ndarray, q: tuple[float, ...], v: tuple[float, ...]
) -> np.ndarray:
    start = {"qpos": torch.tensor([q], dtype=torch.float64), "qvel": torch.tensor([v], dtype=torch.float64)}
    times = simulator.timestep * torch.arange(1, len(command) + 1, dtype=torch.float64)
    inputs = TensorDict({"command": torch.from_numpy(command)[None, :, None]}, batch_size=[1, len(command)])
    state = TensorDict(start, batch_size=[1])
    return simulator.rollout(torch.tensor([theta], dtype=torch.float64), state, inputs, times)["qpos"][0].numpy()


def test_a_sliding_coefficient_is_recovered_from_coulombs_law() -> None:
    # Below and above the floor's own: the larger of two geoms' coefficients no longer decides.
    command = np.where(np.arange(400) < 200, 30.0, -5.0)
    for mu in (0.2, 1.1):
        v, q, path = 0.0, 0.0, []
        for u in command:
            v += H * (u - np.sign(v + H * u / 2) * mu * 2 * G) / 2
            q += H * v
            path.append(q)
        effect = ContactFriction("runner", Parameter(0.0, 2.0), own=0.8)
        simulator = MujocoSimulator(SLEDGE).with_effect(effect)

        def wrong(x: float, simulator: MujocoSimulator = simulator, path: list[float] = path) -> float:
            return float(np.square(_rolled(simulator, [x], command, (0.0, -1e-4), (0.0, 0.0))[:, 0] - path).sum())

        assert minimize_scalar(wrong, bounds=(0.0, 2.0), method="bounded").x == pytest.approx(mu, rel=0.01)


def test_softness_is_recovered_from_the_documented_spring() -> None:
    # In contact the acceleration is (1 - d) times the free one and d times that of the spring.
    T, ratio, d = 0.08, 0.3, 0.9
    b, k = 2 / (d * T), d / (d * T * ratio) ** 2
    command = 3.0 * np.sin(0.05 * np.arange(500)) - 60.0

    def rate(t: float, y: np.ndarray) -> list[float]:
        free = command[min(int(t / H), 499)] / 2 - G
        return [y[1], (1 - d) * free + d * (-b * y[1] - k * y[0])]

    times = H * np.arange(1, 501)
    path = solve_ivp(rate, (0, times[-1]), [-0.004, 0.0], t_eval=times, max_step=H, rtol=1e-9, atol=1e-12).y[0]
    assert path.max() < 0  # it never leaves the floor
    effect = ContactSoftness("ball", Parameter(0.01, 0.2, "s", "log"), Parameter(0.1, 2.0))
    simulator = MujocoSimulator(BALL).with_effect(effect)

    def wrong(x: np.ndarray) -> np.ndarray:
        return _rolled(simulator, x.tolist(), command, (-0.004,), (0.0,))[:, 0] - path

    found = least_squares(wrong, [0.05, 0.6], bounds=([0.01, 0.1], [0.2, 2.0]), x_scale=[0.05, 0.5], xtol=1e-12)
    assert found.x.tolist() == pytest.approx([T, ratio], rel=5e-3)


@pytest.mark.parametrize(
    ("model", "effect", "start"),
    [
        (SLEDGE, ContactFriction("runner", Parameter(0.0, 2.0), 0.8), ((0.0, -1e-4), (1.0, 0.0))),
        (BALL, ContactSoftness("ball", Parameter(0.01, 0.2, "s"), Parameter(0.1, 2.0)), ((-0.01,), (0.0,))),
    ],
    ids=["friction", "softness"],
)
def test_conformance_in_contact(model: str, effect: Effect, start) -> None:
    # The box lies on the floor, so that each parameter acts from the first step on.
    check_effect(MujocoSimulator(model.replace(' pos="0 0 .1"', ' pos="0 0 .0999"')), effect, scale=20.0)


def test_at_the_models_own_nothing_changes_though_partners_differ() -> None:
    uneven = BALL.replace('<geom name="floor"', '<geom name="floor" priority="0" solmix="3" friction=".2" condim="4"')
    command = np.full(100, -20.0)
    plain = _rolled(MujocoSimulator(uneven), [], command, (0.01,), (-1.0,))
    own = MujocoSimulator(uneven).contacts["ball"]
    for effect, theta in (
        (ContactFriction.scaled("ball", Scales(1, 1, 1, 1, contact=own)), [own.friction]),
        (ContactSoftness.scaled("ball", Scales(1, 1, 1, 1, contact=own)), [own.time_constant, own.damping_ratio]),
    ):
        simulator = MujocoSimulator(uneven).with_effect(effect)
        assert simulator.nominal.tolist() == theta
        assert np.array_equal(_rolled(simulator, theta, command, (0.01,), (-1.0,)), plain)
        # Close to it almost nothing: the geom that decides alone has what the two had together.
        near = [theta[0] * (1 + 1e-7), *theta[1:]]
        assert _rolled(simulator, near, command, (0.01,), (-1.0,)) == pytest.approx(plain, abs=1e-7)


def test_two_effects_on_one_geom_stand_together() -> None:
    simulator = MujocoSimulator(SLEDGE, ParameterSpace({"geom.runner.friction[1]": Parameter(0.0, 1.0)}))
    simulator = simulator.with_effect(ContactFriction("runner", Parameter(0.0, 2.0), 0.8))
    simulator = simulator.with_effect(ContactSoftness("runner", Parameter(0.01, 0.2), Parameter(0.1, 2.0)))
    fields = simulator.fields(np.array([[0.7, 0.4, 0.05, 0.5]]))
    runner = simulator.model.geom("runner").id
    assert fields["geom_friction"][0, runner].tolist() == [0.4, 0.7, 0.0001]
    assert fields["geom_solref"][0, runner].tolist() == [0.05, 0.5]
    assert fields["geom_priority"][0].tolist() == [0, 1]


def test_targets_are_what_moves_and_can_touch() -> None:
    named = Contact(0.8, 0.02, 1.0)
    assert contacts(MujocoSimulator(SLEDGE).model) == {"sledge": replace(named, covered=True), "runner": named}
    unnamed = SLEDGE.replace('<geom name="runner"', "<geom")
    assert tuple(contacts(MujocoSimulator(unnamed).model)) == ("sledge",)
    # Upper arm and forearm are parent and child, which do not touch; both can touch the floor.
    assert set(contacts(MujocoSimulator(ARM).model)) == {"upper", "fore"}
    alone = SLEDGE.replace('<geom name="floor"', '<geom name="floor" contype="0" conaffinity="0"')
    assert contacts(MujocoSimulator(alone).model) == {}
    with pytest.raises(BadInput, match="nearest: runner"):
        MujocoSimulator(SLEDGE).with_effect(ContactFriction("runer", Parameter(0.0, 2.0)))
    with pytest.raises(BadInput, match="stiffness and damping"):
        ContactSoftness("ball", Parameter(0.01, 0.2), Parameter(0.1, 2.0), own=(-900.0, -30.0))


@pytest.mark.parametrize(
    "second", ["", '<geom name="second" size=".1" pos="0 .5 0"/>', '<geom size=".1" pos="0 .5 0"/>']
)
def test_a_body_stands_for_all_of_its_geoms(second: str) -> None:
    """Named ones, unnamed ones, both; unasked either the geoms or their body are tried."""
    model = SLEDGE.replace('friction=".3"/>', f'friction=".3"/>{second}')
    simulator = MujocoSimulator(model).with_effect(ContactFriction("sledge", Parameter(0.0, 2.0), 0.8))
    fields = simulator.fields(np.array([[0.4]]))
    assert fields["geom_friction"][0, 1:, 0].tolist() == [0.4] * (2 if second else 1)
    tried = {target for target, contact in simulator.contacts.items() if not contact.covered}
    nameless = bool(second) and "name" not in second
    assert tried == ({"sledge"} if nameless else {"runner", "second"} if second else {"runner"})


@pytest.mark.parametrize(("model", "target"), [(SLEDGE, "runner"), (SLEDGE.replace('name="runner" ', ""), "sledge")])
def test_refined_models_keep_the_contact(model: str, target: str) -> None:
    simulator = MujocoSimulator(model).with_effect(ContactFriction(target, Parameter(0.0, 2.0), 0.8))
    theta, command = torch.tensor([0.4], dtype=torch.float64), np.full(200, 30.0)
    assert simulator.not_exportable(theta) == {}
    plain = MujocoSimulator(simulator.export_xml(theta))
    here = _rolled(simulator, [0.4], command, (0.0, -1e-4), (1.0, 0.0))
    assert np.array_equal(_rolled(plain, [], command, (0.0, -1e-4), (1.0, 0.0)), here)
