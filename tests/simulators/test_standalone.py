"""Every effect is in the exported file, in the Python module beside it, or says why it is in neither."""

from __future__ import annotations

import importlib.util
import inspect
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.effects import EFFECTS, ActuatorDeadZone, ActuatorDelay, Cogging, Effect, Scales
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.sensing import sense
from onlinebayes.simulators.standalone import module_text
from tests.simulators.models import ARM, SLIDE, TUMBLER

SPACE = ParameterSpace({"joint.elbow.damping": Parameter(0.05, 1.0, "N m s/rad")})
PLACES = {
    "joint": "elbow",
    "actuator": "bend",
    "body": "fore",
    "geom": "fore",
    "world": "world",
    "signal": "qpos.elbow",
    "parameter": "joint.elbow.damping",
}
SCALES = Scales(
    force=4.0, speed=6.0, travel=3.0, time=0.05, centre=0.4, inertia=0.03, span=(0.0, 10.0), bounds=Parameter(0.0, 1.0)
)
SAYS_WHY = {"sensor_clock", "parameter_drift", "parameter_step"}
STEPS = 300


def grown(names: Sequence[str], runge_kutta: bool = False) -> MujocoSimulator:
    simulator = MujocoSimulator(ARM, SPACE, threads=1, sensors=("sensor.reading",))
    simulator = simulator.with_runge_kutta() if runge_kutta else simulator
    for name in names:
        simulator = simulator.with_effect(EFFECTS[name].scaled(PLACES[EFFECTS[name].target_kind], SCALES))
    return simulator


def drawn(simulator: MujocoSimulator, seed: int = 0) -> tuple[Tensor, TensorDict, Tensor]:
    """Parameters, a start that moves, and random commands that are held for some timesteps each."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*size: int) -> Tensor:
        return torch.randn(*size, generator=generator, dtype=torch.float64)

    unit = torch.rand(len(simulator.parameters), generator=generator, dtype=torch.float64)
    theta = simulator.parameters.from_unit(0.1 + 0.8 * unit)
    start = simulator.with_worlds(1).state
    start["qpos"], start["qvel"] = 0.3 * normal(*start["qpos"].shape), 0.5 * normal(*start["qvel"].shape)
    command = 1.5 * normal(STEPS // 10, len(simulator.commands)).repeat_interleave(10, 0)
    return theta, start, command


def simulated(simulator: MujocoSimulator, theta: Tensor, start: TensorDict, command: Tensor) -> np.ndarray:
    """Signals as the sensors show them, after each timestep."""
    times = simulator.timestep * torch.arange(1, len(command) + 1, dtype=torch.float64)
    inputs = TensorDict({"command": command[None]}, batch_size=[1, len(command)])
    trajectory = simulator.rollout(theta[None], start, inputs, times)
    assert bool(trajectory["valid"].all())
    return sense(simulator, theta[None], start, trajectory, times)[0].numpy()


def written(simulator: MujocoSimulator, theta: Tensor, folder: Path) -> dict[str, str]:
    """Write both files; returns the effects that are in neither, and why."""
    held = simulator.in_file(theta)
    (folder / "refined.xml").write_text(held.simulator.export_xml(held.theta))
    setup, without = simulator.beside_file(theta, held.simulator.export(held.theta), held.without)
    (folder / "refined_model.py").write_text(module_text(setup, "refined.xml", "A model."))
    return without


def stepped(folder: Path, start: TensorDict, command: Tensor) -> np.ndarray:
    """Signals by the module alone, after each timestep."""
    spec = importlib.util.spec_from_file_location("refined_model", folder / "refined_model.py")
    assert spec is not None
    assert spec.loader is not None
    sys.modules["refined_model"] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    model = module.RefinedModel()
    model.reset(0.5 + start["qpos"][0].numpy())  # what happened before a reset is forgotten
    model.step(command[0].numpy(), steps=3)
    model.reset(start["qpos"][0].numpy(), start["qvel"][0].numpy())
    return np.array([list(model.step(u).values()) for u in command.numpy()])


def plain(folder: Path, start: TensorDict, command: Tensor, timestep: float) -> np.ndarray:
    """Positions and velocities by plain MuJoCo, after each of these timesteps."""
    model = mujoco.MjModel.from_xml_path(str(folder / "refined.xml"))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start["qpos"][0].numpy(), start["qvel"][0].numpy()
    path = []
    for u in command.numpy():
        data.ctrl[: command.shape[1]] = u
        for _ in range(round(timestep / model.opt.timestep)):
            mujoco.mj_step(model, data)
        path.append(np.concatenate([data.qpos, data.qvel]))
    return np.array(path)


def same(one: np.ndarray, other: np.ndarray) -> None:
    assert np.abs(one).max() > 0.1
    assert np.abs(one - other).max() < 1e-9 * np.abs(other).max()


@pytest.mark.parametrize("runge_kutta", [False, True], ids=["implicitfast", "RK4"])
@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_is_in_the_file_or_beside_it_or_says_why(name: str, runge_kutta: bool, tmp_path: Path) -> None:
    simulator = grown([name], runge_kutta)
    theta, start, command = drawn(simulator)
    held, without = simulator.in_file(theta), written(simulator, theta, tmp_path)
    key = simulator.effects[0].key
    assert set(without) == ({key} if name in SAYS_WHY else set())
    assert all(why.startswith("which is ") for why in without.values())
    assert set(held.without) <= {key}
    ours = simulated(simulator, theta, start, command)
    if name not in SAYS_WHY:
        same(stepped(tmp_path, start, command), ours)
    if not held.without and not held.integrated:
        same(plain(tmp_path, start, command, simulator.timestep), ours[:, :4])


@pytest.mark.parametrize("runge_kutta", [False, True], ids=["implicitfast", "RK4"])
def test_laws_act_together_in_their_order(runge_kutta: bool, tmp_path: Path) -> None:
    names = ["actuator_delay", "actuator_dead_zone", "actuator_lag", "load_dependent_friction", "stribeck_friction"]
    names += ["thermal_derating", "cogging", "dry_friction", "actuator_gain", "sensor_bias", "sensor_delay"]
    simulator = grown(names, runge_kutta)
    theta, start, command = drawn(simulator, 1)
    assert written(simulator, theta, tmp_path) == {}
    same(stepped(tmp_path, start, command), simulated(simulator, theta, start, command))


@pytest.mark.parametrize("runge_kutta", [False, True])
@pytest.mark.parametrize("steps", [0.3, 0.9, 1.0, 2.6])
def test_the_file_has_the_integration_under_which_mujoco_holds_a_delay(
    runge_kutta: bool, steps: float, tmp_path: Path
) -> None:
    simulator = MujocoSimulator(SLIDE, threads=1)
    simulator = simulator.with_runge_kutta() if runge_kutta else simulator
    simulator = simulator.with_effect(ActuatorDelay("motor", Parameter(0.0, 0.02, "s")))
    _, start, command = drawn(simulator)
    theta = torch.tensor([steps * simulator.timestep], dtype=torch.float64)
    held = simulator.in_file(theta)
    assert held.without == {}
    assert ("timestep 0" in " ".join(held.integrated)) == (steps < 1)
    assert ("implicitfast" in " ".join(held.integrated)) == (runge_kutta and steps != 1.0)
    written(simulator, theta, tmp_path)
    parts = round(simulator.timestep / held.simulator.timestep)
    fine = simulated(held.simulator, held.theta, start, command.repeat_interleave(parts, 0))[parts - 1 :: parts]
    same(plain(tmp_path, start, command, simulator.timestep), fine)
    same(stepped(tmp_path, start, command), simulated(simulator, theta, start, command))


def test_a_delay_that_would_need_tiny_timesteps_is_left_to_the_module(tmp_path: Path) -> None:
    simulator = MujocoSimulator(SLIDE, threads=1).with_effect(ActuatorDelay("motor", Parameter(0.0, 0.02, "s")))
    theta, (_, start, command) = torch.tensor([1e-5], dtype=torch.float64), drawn(simulator)
    assert tuple(simulator.in_file(theta).without) == ("actuator_delay@motor",)
    assert simulator.in_file(theta).simulator.timestep == simulator.timestep
    written(simulator, theta, tmp_path)
    same(stepped(tmp_path, start, command), simulated(simulator, theta, start, command))


def test_gears_free_joints_and_actuators_with_activations(tmp_path: Path) -> None:
    geared = MujocoSimulator(ARM, SPACE, threads=1)
    for name in ("servo_law", "thermal_derating"):
        geared = geared.with_effect(EFFECTS[name].scaled("lift", SCALES))
    geared = geared.with_effect(EFFECTS["load_dependent_stribeck"].scaled("shoulder", SCALES))
    free = MujocoSimulator(TUMBLER, threads=1)
    places = {"actuator_dead_zone": "slow", "sensor_delay": "qpos.free.0", "sensor_scale": "qvel.ball.1"}
    for name, target in places.items():
        free = free.with_effect(EFFECTS[name].scaled(target, SCALES))
    for simulator in (geared, free):
        theta, start, command = drawn(simulator, 2)
        start = start if simulator is geared else simulator.with_worlds(1).state
        assert written(simulator, theta, tmp_path) == {}
        same(stepped(tmp_path, start, command), simulated(simulator, theta, start, command))


class Silent(Cogging):
    """An effect of a user's that says nothing of a plain form."""

    name = "silent"
    standalone = Effect.standalone


def test_an_effect_of_ones_own_without_a_plain_law_says_so(tmp_path: Path) -> None:
    cogging = Cogging.scaled("rail", SCALES)
    simulator = MujocoSimulator(SLIDE, threads=1).with_effect(Silent("rail", *cogging.parameters.values()))
    without = written(simulator, simulator.nominal, tmp_path)
    assert without == {"silent@rail": "which gives no law in plain Python (Effect.standalone)"}


def test_the_module_needs_neither_torch_nor_this_library(tmp_path: Path) -> None:
    simulator = MujocoSimulator(SLIDE, threads=1).with_effect(ActuatorDeadZone("motor", Parameter(0.0, 1.0)))
    written(simulator, torch.tensor([0.3], dtype=torch.float64), tmp_path)
    text = (tmp_path / "refined_model.py").read_text()
    imports = [line for line in text.splitlines() if line.startswith(("import ", "from "))]
    assert {line.split()[1].partition(".")[0] for line in imports} <= {
        "__future__", "collections", "dataclasses", "math", "mujoco", "numpy", "pathlib",
    }  # fmt: skip
    assert "DeadZone(width=0.3)" in text


@pytest.mark.parametrize("points_at", ["the decorator", "the class"])
def test_a_class_keeps_its_decorators_wherever_python_says_that_it_begins(
    points_at: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Under an import hook ``inspect.findsource`` points at the decorator up to Python 3.12, at the class from 3.13."""
    found = inspect.findsource

    def pointed(part: object) -> tuple[list[str], int]:
        lines, line = found(part)
        line = next(k for k in range(line, len(lines)) if lines[k].startswith(("class ", "def ")))
        while points_at == "the decorator" and lines[line - 1].startswith("@"):
            line -= 1
        return lines, line

    monkeypatch.setattr(inspect, "findsource", pointed)
    simulator = MujocoSimulator(SLIDE, threads=1).with_effect(ActuatorDeadZone("motor", Parameter(0.0, 1.0)))
    written(simulator, torch.tensor([0.3], dtype=torch.float64), tmp_path)
    text = (tmp_path / "refined_model.py").read_text()
    assert "@dataclass\nclass DeadZone(Law):" in text
