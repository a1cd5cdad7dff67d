from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import (
    EFFECTS,
    ActuatorDeadZone,
    ActuatorDelay,
    ActuatorLag,
    Cogging,
    Scales,
    SensorBias,
)
from onlinebayes.simulators.mujoco import NATIVE, MujocoSimulator
from onlinebayes.simulators.mujoco.foreign import NO_TERM
from tests.simulators.models import ARM, SLIDE
from tests.simulators.test_mujoco import ARM_SPACE

SPACE = ParameterSpace(
    {
        # All of the arm's, but the inertia about one transverse axis alone: no body has such a thing.
        **{name: parameter for name, parameter in ARM_SPACE.items() if name != "body.fore.inertia[1]"},
        "body.fore.inertia[2]": Parameter(1e-4, 1e-3, "kg m2"),
        "joint.shoulder.damping[1]": Parameter(0.0, 0.5),
        "joint.elbow.stiffness": Parameter(0.0, 3.0),
        "joint.shoulder.range[1]": Parameter(1.0, 2.5, "rad"),
        "actuator.bend.forcerange[1]": Parameter(2.0, 8.0, "N m"),
        "actuator.lift.ctrlrange[0]": Parameter(-2.0, -0.5),
        "site.tip.pos[0]": Parameter(0.1, 1.0, "m"),
        "sensor.reading.noise": Parameter(0.0, 0.1),
        "option.wind[0]": Parameter(-1.0, 1.0, "m/s"),
        "option.density": Parameter(0.0, 2.0, "kg/m3"),
    }
)


def _plain(model: mujoco.MjModel, command: Tensor) -> np.ndarray:
    data = mujoco.MjData(model)
    path = []
    for u in command.numpy():
        data.ctrl[: command.shape[1]] = u
        mujoco.mj_step(model, data)
        path.append(data.qpos.copy())
    return np.array(path)


def _rolled(simulator: MujocoSimulator, theta: Tensor, command: Tensor) -> np.ndarray:
    steps = len(command)
    times = simulator.timestep * torch.arange(1, steps + 1, dtype=torch.float64)
    start = simulator.with_worlds(1).state
    inputs = TensorDict({"command": command[None]}, batch_size=[1, steps])
    return simulator.rollout(theta[None], start, inputs, times)["qpos"][0].numpy()


@pytest.mark.parametrize(("seed", "own_air"), [(0, True), (1, False), (2, False)])
def test_plain_mujoco_replays_the_file_alike(seed: int, own_air: bool) -> None:
    torch.manual_seed(seed)
    simulator = MujocoSimulator(ARM, SPACE if own_air else SPACE.subspace(n for n in SPACE if n != "option.density"))
    elbow = Scales(force=4.0, speed=6.0, travel=3.0, time=0.05, centre=0.4)
    places = {"joint": "elbow", "actuator": "bend", "body": "fore", "geom": "fore", "world": "world"}
    for cls in EFFECTS.values():
        # Input stages that MuJoCo has not, force stages and sensors have no place in the file.
        if own_air and cls in NATIVE and "option.density" in NATIVE[cls].excludes:
            continue
        if cls in NATIVE or (cls.has_command and cls not in (ActuatorLag, ActuatorDeadZone)):
            simulator = simulator.with_effect(cls.scaled(places[cls.target_kind], elbow))
    theta = simulator.parameters.from_unit(0.1 + 0.8 * torch.rand(len(simulator.parameters), dtype=torch.float64))
    # Beyond the motor's limits, too; at rest before the first command, as a delay's buffer has it.
    command = 1.5 * torch.randn(400, 2, dtype=torch.float64)
    assert simulator.not_exportable(theta) == {}
    model = mujoco.MjModel.from_xml_string(simulator.export_xml(theta))
    assert np.abs(_plain(model, command) - _rolled(simulator, theta, command)).max() < 1e-9
    assert np.abs(_plain(simulator.export(theta).compile(), command) - _plain(model, command)).max() < 1e-9


def test_force_stages_and_sensors_are_foreign() -> None:
    scales = Scales(force=4.0, speed=6.0, travel=3.0, time=0.05)
    simulator = MujocoSimulator(ARM).with_effect(Cogging.scaled("elbow", scales))
    simulator = simulator.with_effect(SensorBias.scaled("qpos.elbow", scales))
    assert simulator.not_exportable(simulator.nominal) == dict.fromkeys(
        ("cogging@elbow", "sensor_bias@qpos.elbow"), NO_TERM
    )


def test_a_pair_of_geoms_has_contact_parameters() -> None:
    xml = """<mujoco><option cone="elliptic"/><worldbody><geom name="floor" type="plane" size="1 1 1"/>
        <body pos="0 0 .1"><joint name="along" type="slide" axis="1 0 0"/><joint name="up" type="slide" axis="0 0 1"/>
        <geom name="box" size=".1"/></body></worldbody>
        <contact><pair name="ground" geom1="floor" geom2="box" friction=".5 .5"/></contact></mujoco>"""
    names = ("pair.ground.friction[0]", "pair.ground.friction[1]", "pair.ground.solreffriction[0]")
    simulator = MujocoSimulator(xml, ParameterSpace({name: Parameter(0.004, 1.0) for name in names}))
    assert simulator.nominal.tolist() == [0.5, 0.5, 0.0]
    start = simulator.with_worlds(2).state
    start["qvel"][:, 0] = 1.0
    theta = torch.tensor([[0.1, 0.1, 0.02], [0.4, 0.4, 0.02]])
    inputs = TensorDict({"command": torch.zeros(2, 1, 0)}, batch_size=[2, 1])
    end = simulator.rollout(theta, start, inputs, torch.tensor([0.2]))["qvel"][:, 0, 0]
    assert end.tolist() == pytest.approx([1 - 0.1 * 9.81 * 0.2, 1 - 0.4 * 9.81 * 0.2], abs=0.02)
    again = MujocoSimulator(simulator.export_xml(theta[1]), simulator.parameters)
    assert torch.allclose(again.nominal, theta[1].double())


def test_each_parameter_arrives_in_the_file() -> None:
    simulator = MujocoSimulator(ARM, SPACE)
    theta = SPACE.from_unit(torch.rand(len(SPACE), dtype=torch.float64))
    again = MujocoSimulator(simulator.export_xml(theta), SPACE)
    assert torch.allclose(again.nominal, theta, rtol=1e-12, atol=1e-15)


def test_what_is_not_changed_stays_as_it_was_written() -> None:
    space = ARM_SPACE.subspace([name for name in ARM_SPACE if "springref" not in name])
    simulator = MujocoSimulator(ARM, space)
    spec = mujoco.MjSpec.from_string(ARM)
    spec.compile()
    assert simulator.export(simulator.nominal).to_xml() == spec.to_xml()


def test_a_delay_of_less_than_a_timestep_is_foreign() -> None:
    simulator = MujocoSimulator(SLIDE).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.02, "s")))
    (why,) = simulator.not_exportable(torch.tensor([0.001]).double()).values()
    assert why == (
        "which plain MuJoCo has from one timestep on (0.002 s): "
        'timestep="0.001", and delay="0.001" interp="linear" nsample="3" at the actuator, hold it'
    )
    assert simulator.not_exportable(torch.tensor([0.0]).double()) == {}
    assert simulator.not_exportable(torch.tensor([0.002]).double()) == {}
    assert "delay=" not in simulator.export_xml(torch.tensor([0.001]).double())
    assert "delay=" in simulator.export_xml(torch.tensor([0.003]).double())


def test_a_delay_under_runge_and_kutta_is_foreign_but_of_one_timestep() -> None:
    simulator = MujocoSimulator(SLIDE).with_runge_kutta().with_effect(ActuatorDelay("motor", Parameter(0, 0.02, "s")))
    step = simulator.timestep
    command = torch.sin(0.1 * torch.arange(300.0).double())[:, None]
    for steps, samples in ((1.0, ""), (1.5, "4"), (2.0, "4")):
        theta = torch.tensor([steps * step], dtype=torch.float64)
        why = "".join(simulator.not_exportable(theta).values())
        if not samples:
            assert why == ""
            model = mujoco.MjModel.from_xml_string(simulator.export_xml(theta))
            assert np.abs(_plain(model, command) - _rolled(simulator, theta, command)).max() < 1e-12
        else:
            assert why == (
                f"which plain MuJoCo has under RK4 for one timestep alone ({step:g} s): "
                f'integrator="implicitfast", and delay="{steps * step:g}" interp="linear" nsample="{samples}" '
                "at the actuator, hold it"
            )


@pytest.mark.parametrize(("steps", "runge_kutta"), [(0.4, False), (0.4, True), (2.5, True)])
def test_what_is_said_of_a_delay_lets_mujoco_hold_it(steps: float, runge_kutta: bool) -> None:
    """The file with the changes that the reason names replays as the simulator with these changes does."""
    plain = MujocoSimulator(SLIDE).with_effect(ActuatorDelay("motor", Parameter(0, 0.02, "s")))
    simulator = plain.with_runge_kutta() if runge_kutta else plain
    theta = torch.tensor([steps * simulator.timestep], dtype=torch.float64)
    (why,) = simulator.not_exportable(theta).values()
    said = dict(re.findall(r'(\w+)="([^"]+)"', why))
    spec, delayed = simulator.export(theta), simulator
    if "timestep" in said:
        spec.option.timestep, delayed = float(said["timestep"]), simulator.with_timestep(float(said["timestep"]))
    if "integrator" in said:
        spec.option.integrator, delayed = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, simulator.with_first_order()
    motor = spec.actuator("motor")
    motor.delay, motor.interp, motor.nsample = float(said["delay"]), 1, int(said["nsample"])
    command = torch.sin(0.1 * torch.arange(300.0).double())[:, None]
    assert np.abs(_plain(spec.compile(), command) - _rolled(delayed, theta, command)).max() < 1e-12


def test_an_inertia_that_no_body_has_becomes_the_nearest_one() -> None:
    simulator = MujocoSimulator(ARM, ParameterSpace({"body.fore.inertia[1]": Parameter(0.02, 0.2, "kg m2")}))
    theta = torch.tensor([0.2]).double()
    A, B, C = np.sort(simulator.fields(theta[None].numpy())["body_inertia"][0, simulator.model.body("fore").id])
    moments = np.sort(mujoco.MjModel.from_xml_string(simulator.export_xml(theta)).body("fore").inertia)
    s = (C - A - B) / 3
    assert s > 0
    assert moments == pytest.approx([A + s, B + s, C - s], rel=1e-9)
    assert simulator.bodies_with_adjusted_inertia(theta) == ("fore",)
    assert simulator.bodies_with_adjusted_inertia(simulator.nominal) == ()


def test_precision_is_put_back() -> None:
    simulator = MujocoSimulator(SLIDE, ParameterSpace({"joint.rail.damping": Parameter(0.0, 1.0)}))
    theta = torch.tensor([1.0 / 3.0], dtype=torch.float64)
    assert 'damping="0.3333333333333333' in simulator.export_xml(theta)
    assert 'damping="0.333333"' in simulator.export(theta).to_xml()
