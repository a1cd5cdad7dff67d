"""Where a recording begins: at rest, under the command that holds the posture, whatever the log's first row says."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.experiment.check import check_table
from onlinebayes.criticism.experiment.inputs import Inputs, admissible_inputs
from onlinebayes.criticism.experiment.limits import Limits
from onlinebayes.criticism.experiment.play import FixedModel, play
from onlinebayes.criticism.experiment.postures import postures
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.mujoco import MujocoSimulator

ARM = """
<mujoco><option timestep="0.01" integrator="RK4"/><worldbody><body name="arm">
  <joint name="hinge" axis="0 1 0" damping="0.05"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.02" mass="0.5"/>
</body></worldbody><actuator>{}</actuator></mujoco>"""
MOTOR = '<motor name="m1" joint="hinge"/>'
SERVO = '<position name="m1" joint="hinge" kp="4" kv="0.2" forcerange="-3 3"/>'
WEIGHT = 0.5 * 9.81 * 0.2  # m g l [N m]
SPACE = ParameterSpace({"joint.hinge.damping": Parameter(0.0, 1.0)})


def hypothesis(actuator: str) -> FixedModel:
    return FixedModel("arm", MujocoSimulator(ARM.format(actuator), SPACE, threads=1), torch.tensor([0.05]).double())


def windows_from(model: FixedModel, starts: tuple[float, ...], first: float) -> Windows:
    """Runs at rest in these postures by their positions, whose tables begin with a command that does not hold them."""
    time = torch.arange(101, dtype=torch.float64) * 0.01
    runs = {
        f"run{r}": {
            "time": time.numpy(),
            "ctrl.m1": (first * torch.cos(5 * time)).numpy(),
            "qpos.hinge": (q + 0.05 * (1 - torch.cos(6 * time))).numpy(),
        }
        for r, q in enumerate(starts)
    }
    table = Measurement.from_runs(runs, signals=[Signal("qpos.hinge", "rad", sd=1e-5)], commands=["m1"])
    return make_windows(model.simulator, table, 0.5, 10.0)


def limits(command: float, rate: float = 5.0) -> Limits:
    one = torch.ones(1, dtype=torch.float64)
    return Limits(-command * one, command * one, rate * one, -2 * one, 2 * one, 8 * one, 3.0)


def test_a_motor_is_held_by_the_weight_not_by_the_first_row_of_a_log() -> None:
    """A hanging arm needs nothing; one that is raised needs m g l sin q."""
    model = hypothesis(MOTOR)
    low, high = postures(windows_from(model, (0.0, 1.0), -0.32), limits(2.0), model)
    assert float(low.held) == pytest.approx(0.0, abs=1e-3)
    # MuJoCo's hinge turns about +y, so that the arm hangs at q = 0 and its weight pulls back towards it.
    assert float(high.held) == pytest.approx(WEIGHT * float(torch.sin(high.start)), rel=1e-3)
    assert high.name == ", from where run 'run1' began"


def test_a_servo_is_held_by_a_setpoint_above_the_posture() -> None:
    """kp (u - q) carries the weight, also where the log's first command saturates it."""
    model = hypothesis(SERVO)
    (start,) = postures(windows_from(model, (0.6,), -5.0), limits(6.0), model)
    carried = 4 * (float(start.held) - float(start.start))
    assert carried == pytest.approx(WEIGHT * float(torch.sin(start.start)), rel=1e-3)


def test_tables_begin_and_end_there_within_the_limits() -> None:
    """A rate and a bound that the log's own commands break."""
    model, narrow = hypothesis(MOTOR), limits(0.2, 1.0)
    windows = windows_from(model, (0.0,), -0.32)
    starts = postures(windows, narrow, model)
    inputs = admissible_inputs(windows, narrow, ("m1",), starts)
    time = torch.arange(inputs.command.shape[1], dtype=torch.float64) * inputs.step
    assert float(inputs.command.abs().max()) <= 0.2
    for command in inputs.command:
        check_table(time, command, starts[0].held, narrow, ("m1",))


def test_what_no_admissible_command_holds_is_left_out_or_refused() -> None:
    """Raised by a radian the arm needs 0.83 N m."""
    model = hypothesis(MOTOR)
    (start,) = postures(windows_from(model, (1.0, 0.0), -0.32), limits(0.5), model)
    assert abs(float(start.start)) < 0.1
    with pytest.raises(BadInput, match=r"takes m1 = 0\.8\d+, where \[-0\.5, 0\.5\] is allowed; raise max_command"):
        postures(windows_from(model, (1.0,), -0.32), limits(0.5), model)


def test_a_posture_that_no_command_holds_is_refused() -> None:
    """The actuator drives another joint."""
    other = (
        "</worldbody>",
        '<body name="b"><joint name="free" type="slide" axis="1 0 0"/><geom size=".1"/></body></worldbody>',
    )
    text = ARM.format('<motor name="m1" joint="free"/>').replace(*other)
    model = FixedModel("arm", MujocoSimulator(text, SPACE, threads=1), torch.tensor([0.05]).double())
    q = {"time": torch.arange(101).numpy() * 0.01, "ctrl.m1": torch.sin(torch.arange(101) * 0.1).numpy()}
    run = {**q, "qpos.hinge": (1.0 + 0.05 * torch.arange(101) ** 0.5).numpy(), "qpos.free": q["ctrl.m1"]}
    signals = [Signal("qpos.hinge", "rad", sd=1e-5), Signal("qpos.free", "m", sd=1e-5)]
    table = Measurement.from_runs({"run0": run}, signals=signals, commands=["m1"])
    one = torch.ones(2, dtype=torch.float64)
    wide = Limits(-one[:1], one[:1], one[:1], -2 * one, 2 * one, 8 * one, 3.0)
    with pytest.raises(BadInput, match=r"no command holds the model at rest where a run began \(the first: hinge = 1"):
        postures(make_windows(model.simulator, table, 0.5, 10.0), wide, model)


def test_a_delayed_command_was_there_before() -> None:
    """The buffer of a delay holds what is held: under it alone nothing moves."""
    model = hypothesis(MOTOR)
    slow = model.simulator.with_effect(ActuatorDelay("m1", Parameter(0.0, 0.1)))
    late = FixedModel("late", slow, torch.tensor([0.05, 0.06]).double())
    start = torch.tensor([[1.0]]).double()
    held = WEIGHT * torch.sin(start)
    still = Inputs(("still",), 0.01, held[:, None].expand(1, 40, 1), start, held, torch.ones(1).double())
    assert float((play(late, still)["qpos"] - 1.0).abs().max()) < 1e-3


@pytest.mark.parametrize(
    ("command", "held", "rate", "message"),
    [
        ((0.0, 0.3, 0.0), 0.0, 100.0, r"m1 is 0\.3, outside \[-0\.2, 0\.2\]"),
        ((0.0, float("nan"), 0.0), 0.0, 100.0, "m1 is nan"),
        ((0.1, 0.2, 0.1), 0.0, 100.0, r"begins or ends at m1 = 0\.1, not 0"),
        ((0.0, 0.2, 0.0), 0.0, 1.0, "changes by 2 a second, above 1"),
    ],
)
def test_a_table_that_breaks_a_limit_is_not_handed_out(
    command: tuple[float, ...], held: float, rate: float, message: str
) -> None:
    """Whatever made it."""
    allowed = replace(limits(0.2), rate=torch.tensor([rate]).double())
    time, column = torch.tensor([0.0, 0.1, 0.2]).double(), torch.tensor(command).double()[:, None]
    with pytest.raises(BadInput, match=message):
        check_table(time, column, torch.tensor([held]).double(), allowed, ("m1",))
