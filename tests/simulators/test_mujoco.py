from __future__ import annotations

import copy
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torch import Tensor

from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator
from onlinebayes.simulators.testing import check_simulator
from tests.simulators.models import ARM, SLIDE, TUMBLER, UNSTABLE

ARM_SPACE = ParameterSpace(
    {
        "body.upper.mass": Parameter(0.5, 3.0, "kg"),
        "body.fore.mass": Parameter(0.3, 2.0, "kg"),
        "body.fore.inertia[1]": Parameter(0.02, 0.2, "kg m2"),
        "body.fore.ipos[0]": Parameter(0.2, 0.5, "m"),
        "joint.shoulder.damping": Parameter(0.0, 1.0, "N m s/rad"),
        "joint.elbow.frictionloss": Parameter(0.0, 0.3, "N m"),
        "joint.elbow.stiffness": Parameter(0.0, 3.0, "N m/rad"),
        "joint.elbow.springref": Parameter(-1.0, 1.0, "rad"),
        "joint.shoulder.armature": Parameter(0.0, 0.1, "kg m2"),
        "geom.floor.friction[0]": Parameter(0.2, 1.5),
        "actuator.lift.gear": Parameter(5.0, 20.0),
        "actuator.bend.kp": Parameter(2.0, 20.0),
        "actuator.bend.kv": Parameter(0.0, 2.0),
        "tendon.cord.stiffness": Parameter(0.0, 2.0),
        "option.gravity[2]": Parameter(-12.0, -8.0, "m/s2"),
    }
)
TUMBLER_SPACE = ParameterSpace(
    {
        "body.box.mass": Parameter(0.5, 2.0, "kg"),
        "joint.ball.damping": Parameter(0.0, 0.1, "N m s/rad"),
        "geom.box.friction[0]": Parameter(0.1, 1.0),
    }
)


def _write(model: mujoco.MjModel, name: str, value: float) -> None:
    """What the address means, written down a second time: straight into one model's fields."""
    kind, element, field = name.split(".") if name.count(".") == 2 else ("option", "", name.split(".")[1])
    field, _, index = field.partition("[")
    i = int(index[:-1]) if index else 0
    if kind == "option":
        getattr(model.opt, field)[i] = value
    elif field == "kp":
        model.actuator(element).gainprm[0], model.actuator(element).biasprm[1] = value, -value
    elif field == "kv":
        model.actuator(element).biasprm[2] = -value
    elif field == "springref":
        model.qpos_spring[model.joint(element).qposadr[0]] = value
    elif kind == "tendon":
        getattr(model, f"tendon_{field}")[model.tendon(element).id] = value
    elif field == "damping":
        model.joint(element).damping[:] = value
    else:
        getattr(getattr(model, kind)(element), field)[i] = value


def _looped(xml: str, names: tuple[str, ...], theta: Tensor, state: TensorDict, command: Tensor) -> TensorDict:
    """A loop of mj_step over copies of the model whose fields were changed and mj_setConst called."""
    base = mujoco.MjModel.from_xml_string(xml)
    rows = []
    for i in range(len(theta)):
        model = copy.copy(base)
        for name, value in zip(names, theta[i].tolist(), strict=True):
            _write(model, name, value)
        data = mujoco.MjData(model)
        mujoco.mj_setConst(model, data)
        data = mujoco.MjData(model)
        for key, part in state[i].items():
            getattr(data, key)[:] = part.numpy()
        steps = []
        for u in command[i].numpy():
            data.ctrl[:] = u
            mujoco.mj_step(model, data)
            steps.append({k: torch.from_numpy(getattr(data, k).copy()) for k in state.keys()})  # noqa: SIM118
        rows.append(torch.stack([TensorDict(s, batch_size=[]) for s in steps]))
    return torch.stack(rows)


def _same(a: TensorDict, b: TensorDict) -> bool:
    return all(torch.equal(a[key], b[key]) for key in b.keys())  # noqa: SIM118


def _steps(simulator: MujocoSimulator, command: Tensor) -> TensorDict:
    states = [
        simulator.step(TensorDict({"command": command[:, k]}, batch_size=[len(command)]))
        for k in range(command.shape[1])
    ]
    return torch.stack(states, dim=1)


@pytest.mark.parametrize(("xml", "space"), [(ARM, ARM_SPACE), (TUMBLER, TUMBLER_SPACE)], ids=["arm", "tumbler"])
@pytest.mark.parametrize("worlds", [1, 7])
@pytest.mark.parametrize("threads", [1, 3])
def test_bit_for_bit_a_loop_of_mj_step(xml: str, space: ParameterSpace, worlds: int, threads: int) -> None:
    simulator = MujocoSimulator(xml, space, worlds=worlds, threads=threads)
    steps = 250
    theta = space.from_unit(torch.rand(worlds, len(space), dtype=torch.float64))
    start = simulator.reset(theta)
    command = torch.randn(worlds, steps, len(simulator.commands), dtype=torch.float64)
    loop = _looped(xml, space.names, theta, start, command)
    assert _same(_steps(simulator, command), loop)
    times = simulator.timestep * torch.arange(1, steps + 1, dtype=torch.float64)
    inputs = TensorDict({"command": command}, batch_size=command.shape[:2])
    assert _same(simulator.rollout(theta, start, inputs, times), loop)


def test_bit_for_bit_through_partial_resets() -> None:
    simulator = MujocoSimulator(ARM, ARM_SPACE, worlds=5)
    theta = ARM_SPACE.from_unit(torch.rand(5, len(ARM_SPACE), dtype=torch.float64))
    start = simulator.reset(theta)
    command = torch.randn(5, 60, 2, dtype=torch.float64)
    for _ in range(4):
        _steps(simulator, command)
        mask = torch.rand(5) < 0.5
        theta = torch.where(mask[:, None], ARM_SPACE.from_unit(torch.rand(5, len(ARM_SPACE)).double()), theta)
        before = simulator.reset(theta, start, mask)
        assert _same(before[mask], start[mask])
        assert torch.equal(simulator.theta, theta)
    assert _same(_steps(simulator, command), _looped(ARM, ARM_SPACE.names, theta, before, command))


def test_a_step_may_be_several_timesteps() -> None:
    fine = MujocoSimulator(ARM, ARM_SPACE, worlds=3)
    coarse = MujocoSimulator(ARM, ARM_SPACE, worlds=3, dt=0.02)
    theta = ARM_SPACE.from_unit(torch.rand(3, len(ARM_SPACE), dtype=torch.float64))
    fine.reset(theta)
    coarse.reset(theta)
    command = torch.randn(3, 10, 2, dtype=torch.float64)
    wanted = _steps(fine, command.repeat_interleave(5, dim=1))[:, 4::5]
    assert _same(_steps(coarse, command), wanted)
    other = fine.with_dt(0.02)
    other.reset(theta)
    assert _same(_steps(other, command), wanted)
    with pytest.raises(BadInput, match="whole number"):
        MujocoSimulator(ARM, dt=0.005)


@pytest.mark.parametrize(
    ("xml", "space", "inert"),
    [
        # The floor's friction acts on contact only, the springref of a stiffness of 0 not at all.
        (ARM, ARM_SPACE, ("geom.floor.friction[0]",)),
        (TUMBLER, TUMBLER_SPACE, ("geom.box.friction[0]",)),
        (SLIDE, ParameterSpace(), ()),
        # The file's own delay: its buffer and the time at which it is read are parts of the state.
        (SLIDE.replace("<motor ", '<motor delay="0.007" nsample="6" interp="linear" '), ParameterSpace(), ()),
    ],
    ids=["arm", "tumbler", "no parameters", "delay of its own"],
)
def test_conformance(xml: str, space: ParameterSpace, inert: tuple[str, ...]) -> None:
    check_simulator(MujocoSimulator(xml, space), inert=inert, steps=12)
    check_simulator(MujocoSimulator(xml, space, dt=0.012, threads=1), inert=inert)


def test_a_diverging_world_is_masked_and_the_others_go_on() -> None:
    space = ParameterSpace({"actuator.blow.biasprm[1]": Parameter(-1e7, 1e7)})
    simulator = MujocoSimulator(UNSTABLE, space, worlds=4)
    theta = torch.tensor([[-1.0], [1e6], [-2.0], [3e4]], dtype=torch.float64)
    start = TensorDict({"qpos": torch.ones(4, 1).double(), "qvel": torch.zeros(4, 1).double()}, batch_size=[4])
    start = simulator.reset(theta, start)
    command = torch.zeros(4, 40, 1, dtype=torch.float64)
    walked = _steps(simulator, command)
    assert simulator.failed.tolist() == [False, True, False, True]
    times = simulator.timestep * torch.arange(1, 41, dtype=torch.float64)
    rolled = simulator.rollout(theta, start, TensorDict({"command": command}, batch_size=[4, 40]), times)
    assert _same(rolled, walked)
    assert bool(rolled["qpos"].isfinite().all())
    for i, loop in enumerate(_looped(UNSTABLE, space.names, theta[::2], start[::2], command[::2])):
        assert bool(rolled["valid"][2 * i].all())
        assert _same(rolled[2 * i], loop)
    # x grows by 1 + k h^2 a step: 1e10, where the engine calls it diverged, is reached by the last valid row at most.
    for i in (1, 3):
        last = int(rolled["valid"][i].sum()) - 1
        assert 0 <= last < 38
        assert not bool(rolled["valid"][i, last + 1 :].any())
        assert torch.equal(rolled["qpos"][i, last + 1 :], rolled["qpos"][i, last].expand(39 - last, 1))
        assert 1.0 < float(rolled["qpos"][i, last]) < 1e10
    simulator.reset(torch.full_like(theta, -1.0), start, simulator.failed)
    assert not bool(simulator.failed.any())
    assert float(_steps(simulator, command)["qpos"].abs().max()) < 1e3


def test_a_world_that_diverged_stays_out_of_the_stretches_between_switches() -> None:
    space = ParameterSpace({"actuator.blow.biasprm[1]": Parameter(-1e7, 1e7)})
    simulator = MujocoSimulator(UNSTABLE, space)
    theta = torch.tensor([[1e6], [-1.0], [-2.0]], dtype=torch.float64)
    start = TensorDict({"qpos": torch.ones(3, 1).double(), "qvel": torch.zeros(3, 1).double()}, batch_size=[3])
    enable = torch.ones(3, 40, 1)
    enable[1, 20:30] = 0
    inputs = TensorDict({"command": torch.zeros(3, 40, 1).double(), "enable": enable}, batch_size=[3, 40])
    times = simulator.timestep * torch.arange(1, 41, dtype=torch.float64)
    rolled = simulator.rollout(theta, start, inputs, times)
    alone = simulator.rollout(theta[1:], start[1:], inputs[1:], times)
    assert _same(rolled[1:].exclude("valid"), alone.exclude("valid"))
    assert rolled["valid"].all(1).tolist() == [False, True, True]
    assert float(rolled["qpos"][0, -1]) == float(rolled["qpos"][0, int(rolled["valid"][0].sum()) - 1])
    # Switched off, mass 1 moves at the speed that it has.
    coast = rolled["qpos"][1, 20:30, 0] - rolled["qpos"][1, 19, 0]
    assert torch.allclose(coast, rolled["qvel"][1, 19] * times[:10], rtol=1e-12, atol=0)


def test_more_worlds_than_memory_holds_go_in_several_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    simulator = MujocoSimulator(ARM, ARM_SPACE, effects=(ActuatorDelay("lift", Parameter(0.0, 0.02, "s")),))
    theta = simulator.parameters.from_unit(torch.rand(7, len(simulator.parameters), dtype=torch.float64))
    start = simulator.with_worlds(7).state
    inputs = TensorDict({"command": torch.randn(7, 30, 2, dtype=torch.float64)}, batch_size=[7, 30])
    times = 0.004 * torch.arange(1, 31, dtype=torch.float64)
    whole = simulator.rollout(theta, start, inputs, times)
    monkeypatch.setattr("onlinebayes.simulators.mujoco.rollout.MEMORY", 30 * 12 * 3)
    parts = simulator.rollout(theta, start, inputs, times)
    assert _same(parts.exclude("effects"), whole.exclude("effects"))
    assert torch.equal(parts["effects", "actuator_delay@lift", "past"], whole["effects", "actuator_delay@lift", "past"])


def test_batches_that_do_not_match_are_named() -> None:
    simulator = MujocoSimulator(SLIDE)
    inputs = TensorDict({"command": torch.zeros(2, 3, 1).double()}, batch_size=[2, 3])
    with pytest.raises(BadInput, match="theta has 1 rows, state 1, inputs 2 x 3, times 3"):
        simulator.rollout(torch.zeros(1, 0).double(), simulator.state, inputs, torch.tensor([0.1, 0.2, 0.3]))


def test_divergence_writes_no_log_and_prints_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    space = ParameterSpace({"actuator.blow.biasprm[1]": Parameter(-1e7, 1e7)})
    simulator = MujocoSimulator(UNSTABLE, space)
    start = TensorDict({"qpos": torch.ones(1, 1).double(), "qvel": torch.zeros(1, 1).double()}, batch_size=[1])
    simulator.reset(torch.tensor([[1e6]], dtype=torch.float64), start)
    _steps(simulator, torch.zeros(1, 20, 1, dtype=torch.float64))
    assert bool(simulator.failed.all())
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")


def test_a_row_spans_whole_timesteps_and_rows_may_fall_together() -> None:
    simulator = MujocoSimulator(SLIDE)
    start = simulator.state
    times = torch.tensor([0.0, 0.0011, 0.0049, 0.0058, 0.0101], dtype=torch.float64)
    command = torch.tensor([9.0, 1.0, 2.0, 3.0, 4.0], dtype=torch.float64).reshape(1, 5, 1)
    rolled = simulator.rollout(
        torch.zeros(1, 0, dtype=torch.float64), start, TensorDict({"command": command}, batch_size=[1, 5]), times
    )
    # 2 kg: marks at 0, 1, 2, 3, 5 timesteps of 2 ms; the first command holds for no time at all.
    expected = torch.tensor([0.0, 1.0, 3.0, 6.0, 14.0]).double() * 0.002 / 2
    assert torch.allclose(rolled["qvel"].flatten(), expected, rtol=1e-12, atol=0)
    assert rolled["valid"].all()
    with pytest.raises(BadInput, match="go back"):
        simulator.rollout(torch.zeros(1, 0), start, TensorDict({"command": command}, [1, 5]), times.flip(0))


def test_an_actuator_that_is_off_gives_no_force() -> None:
    simulator = MujocoSimulator(ARM, worlds=2)
    free = MujocoSimulator(ARM.replace('kp="8" kv="0.6"', 'kp="8e-300"').replace('gear="12"', 'gear="0"'), worlds=2)
    command = torch.ones(2, 50, 2, dtype=torch.float64)
    theta = torch.zeros(2, 0, dtype=torch.float64)
    times = 0.004 * torch.arange(1, 51, dtype=torch.float64)
    inputs = TensorDict({"command": command, "enable": torch.zeros_like(command)}, batch_size=[2, 50])
    off = simulator.rollout(theta, simulator.state, inputs, times)
    none = free.rollout(theta, free.state, inputs.exclude("enable"), times)
    assert torch.allclose(off["qpos"], none["qpos"], rtol=0, atol=1e-12)
    on = simulator.rollout(theta, simulator.state, inputs.exclude("enable"), times)
    assert float((on["qpos"] - off["qpos"]).abs().max()) > 0.1


def test_enable_may_change_in_time_and_differ_between_worlds() -> None:
    simulator = MujocoSimulator(SLIDE, worlds=2)
    enable = torch.tensor([[1, 0, 0, 1], [1, 1, 0, 1]]).double()[..., None]
    command = torch.ones(2, 4, 1, dtype=torch.float64)
    times = 0.002 * torch.tensor([1.0, 3.0, 4.0, 6.0], dtype=torch.float64)
    inputs = TensorDict({"command": command, "enable": enable}, batch_size=[2, 4])
    rolled = simulator.rollout(torch.zeros(2, 0, dtype=torch.float64), simulator.state, inputs, times)
    pushes = torch.tensor([[1, 1, 1, 3], [1, 3, 3, 5]]).double()
    assert torch.allclose(rolled["qvel"][..., 0], pushes * 0.002 / 2, rtol=1e-12, atol=0)
    # By steps: the same, and an actuator that is switched on again is as it was.
    for k, hold in enumerate((1, 2, 1, 2)):
        for _ in range(hold):
            state = simulator.step(inputs[:, k])
    assert torch.equal(state["qpos"], rolled["qpos"][:, -1])


def test_switching_keeps_a_limit_that_is_a_parameter() -> None:
    space = ParameterSpace({"actuator.bend.forcerange[1]": Parameter(0.0, 10.0, "N m")})
    simulator = MujocoSimulator(ARM, space, worlds=2)
    theta = torch.tensor([[0.5], [4.0]], dtype=torch.float64)
    command = torch.full((2, 20, 2), 3.0, dtype=torch.float64)
    command[..., 0] = 0
    start = simulator.reset(theta)
    plain = _steps(simulator, command)
    simulator.reset(theta, start)
    off = TensorDict({"command": command[:, 0], "enable": torch.zeros(2, 2)}, batch_size=[2])
    simulator.step(off)
    simulator.reset(theta, start)
    assert _same(_steps(simulator, command), plain)
    assert not torch.equal(plain["qpos"][0], plain["qpos"][1])


def test_signals_of_free_and_ball_joints() -> None:
    simulator = MujocoSimulator(TUMBLER)
    assert simulator.signals[:8] == (*(f"qpos.free.{k}" for k in range(7)), "qpos.ball.0")
    assert simulator.signals[-4:] == ("qvel.free.5", "qvel.ball.0", "qvel.ball.1", "qvel.ball.2")
    assert simulator.commands == ("slow",)
    assert simulator.read(simulator.state).shape == (1, 7 + 4 + 6 + 3)
    assert set(simulator.state.keys()) == {"qpos", "qvel", "act", "qacc_warmstart"}


def test_unnamed_joints_and_actuators_get_names() -> None:
    passive = SLIDE[: SLIDE.index("  <actuator>")] + "</mujoco>"
    simulator = MujocoSimulator(passive.replace('name="rail" ', ""))
    assert simulator.commands == ()
    assert simulator.signals == ("qpos.joint0", "qvel.joint0")
    assert MujocoSimulator(SLIDE.replace('name="motor" ', "")).commands == ("actuator0",)


def test_a_path_a_text_and_a_spec_are_the_same(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(ARM)
    spec = mujoco.MjSpec.from_string(ARM)
    nominal = [MujocoSimulator(model, ARM_SPACE).nominal for model in (ARM, file, str(file), spec)]
    assert all(torch.equal(nominal[0], other) for other in nominal[1:])


@pytest.mark.parametrize(
    ("model", "says"),
    [
        ("no/such/file.xml", "does not exist"),
        ("<mujoco><wrldbody/></mujoco>", "does not compile"),
        ("<mujoco", "does not compile"),
        ('<mujoco><worldbody><body><joint name="j"/></body></worldbody></mujoco>', "mass and inertia"),
        (ARM.replace('joint="elbow" kp', 'joint="elbw" kp'), "elbw"),
    ],
)
def test_a_bad_model_is_one_line(model: str, says: str) -> None:
    with pytest.raises(BadInput, match=says) as error:
        MujocoSimulator(model)
    assert "\n" not in str(error.value)


def test_bad_arguments() -> None:
    with pytest.raises(BadInput, match="at least one world"):
        MujocoSimulator(SLIDE, worlds=0)
    with pytest.raises(BadInput, match="nearest: rail"):
        MujocoSimulator(SLIDE, ParameterSpace({"joint.rial.damping": Parameter(0.0, 1.0)}))
    space = ParameterSpace({"joint.rail.damping": Parameter(0.0, 1.0)})
    with pytest.raises(BadInput, match="not finite"):
        MujocoSimulator(SLIDE, space).reset(torch.tensor([[torch.nan]], dtype=torch.float64))


def test_a_mass_the_engine_refuses_fails_its_world_alone() -> None:
    space = ParameterSpace({"body.carriage.mass": Parameter(0.0, 3.0, "kg")})
    simulator = MujocoSimulator(SLIDE, space, worlds=2)
    simulator.reset(torch.tensor([[-1.0], [2.0]], dtype=torch.float64))
    after = _steps(simulator, torch.ones(2, 3, 1, dtype=torch.float64))
    assert simulator.failed.tolist() == [True, False]
    assert np.isclose(float(after["qvel"][1, -1]), 3 * 0.002 / 2)
