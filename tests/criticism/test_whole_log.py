"""A log of position servos in degrees throughout: positions and commands are put right together, or neither is."""

from __future__ import annotations

import math

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import log_faults, promising_faults
from onlinebayes.criticism.hypotheses.explanation import start_search
from onlinebayes.criticism.wiring.faults import COMMAND, Offset, Rescaled, WholeLog
from onlinebayes.criticism.wiring.possible import possible_faults
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.simulators.mujoco import MujocoSimulator

SERVO = """<mujoco><option timestep="0.005" integrator="implicitfast"/><worldbody><body name="arm"><joint name="arm"
axis="0 1 0" damping="0.3" armature="0.02"/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/></body>
</worldbody><actuator><position name="servo" joint="arm" kp="10"/></actuator></mujoco>"""
FREE = ParameterSpace({"joint.arm.damping": Parameter(0.0, 1.0, "N m s/rad")})


def in_degrees() -> Measurement:
    time = 0.02 * torch.arange(151, dtype=torch.float64)
    told = torch.stack([0.6 * torch.sin(torch.linspace(2, 5, 151) * time + phase) for phase in (0.0, 1.0, 2.0, 3.0)])
    rig = MujocoSimulator(SERVO, FREE, worlds=4, threads=1)
    inputs = TensorDict({"command": told[:, :-1, None]}, [4, 150])
    angle = rig.rollout(torch.full((4, 1), 0.3).double(), rig.state, inputs, time[1:])["qpos"][..., 0]
    angle = torch.nn.functional.pad(angle, (1, 0))
    angle = angle + 1e-3 * torch.randn(angle.shape, generator=torch.Generator().manual_seed(0), dtype=angle.dtype)
    turned = 180 / math.pi
    runs = {f"run{r}": {"time": time, "ctrl.servo": turned * told[r], "qpos.arm": turned * angle[r]} for r in range(4)}
    return Measurement.from_runs(runs, signals=[Signal("qpos.arm", "rad")])


def test_the_whole_log_is_named_before_a_zero_or_one_column(monkeypatch: pytest.MonkeyPatch) -> None:
    model, table = MujocoSimulator(SERVO, FREE, threads=1), in_degrees()
    every = possible_faults(model, table)
    (whole,) = [fault for fault in every if isinstance(fault, WholeLog) and fault.signals.factor < 1]
    rivals = (
        whole,
        Offset("qpos.arm", math.pi / 2),
        Rescaled("signal", ("qpos.arm",), math.pi / 180, "degrees for radians"),
        Rescaled("command", ("servo",), math.pi / 180, COMMAND[math.pi / 180]),
    )
    monkeypatch.setattr(promising_faults, "possible_faults", lambda *_, **__: rivals)
    search = start_search(model, table)
    found = log_faults.find_fault(search.evaluator, search.base, table)
    assert found is not None
    assert found.fault == whole
    assert found.fault.says == "qpos.arm and ctrl.servo: degrees for radians"
    assert found.fault.lines.count("scale = 0.0174532925") == 2


def test_a_log_within_a_turn_or_of_motors_is_not_in_degrees_throughout() -> None:
    table, servo = in_degrees(), MujocoSimulator(SERVO, FREE, threads=1)
    motor = MujocoSimulator(
        SERVO.replace('position name="servo" joint="arm" kp="10"', 'motor name="servo" joint="arm"'), FREE
    )
    (whole,) = [fault for fault in possible_faults(servo, table) if isinstance(fault, WholeLog)]
    for model, log in ((servo, whole.correct(table)), (motor, table)):
        assert not any(isinstance(fault, WholeLog) for fault in possible_faults(model, log))


def test_positions_and_commands_are_put_right_together() -> None:
    table = in_degrees()
    (whole,) = [
        fault
        for fault in possible_faults(MujocoSimulator(SERVO, FREE, threads=1), table)
        if isinstance(fault, WholeLog) and fault.signals.factor < 1
    ]
    right = whole.correct(table).data
    assert float(right["command"].abs().max()) == pytest.approx(0.6, rel=1e-2)
    assert float(right["signal"].abs().max()) < 1.0
