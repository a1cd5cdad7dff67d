"""A late motor on a machine that got no command before its runs, and on one that had long got the first row's."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import begun_as_read, prepare, refine
from onlinebayes.criticism.wiring.readings import IdleBefore
from onlinebayes.identification.data.windows import MEMORY, make_windows
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.parameters import Parameter
from onlinebayes.runs import UNWATCHED
from onlinebayes.simulators.effects import ActuatorDelay
from onlinebayes.simulators.identifiable import Identifiable
from tests.criticism.rigs import NOISE, TRUTH, commands, model

RUNS, ROWS, STEP, LATE = 7, 201, 0.01, 6
TRIED = ["actuator_delay", "actuator_lag", "dry_friction", "sensor_delay"]


def log(idle: bool, late: int = LATE) -> Measurement:
    """Commands act six rows late; before the runs there were none, or the first row's."""
    command = commands(RUNS, ROWS, STEP, seed=3) + 1.0
    before = command[:, :1].repeat(1, late, 1) * (0.0 if idle else 1.0)
    acting = torch.cat([before, command], 1)[:, : ROWS - 1]
    zero = torch.zeros(RUNS, 1, dtype=torch.float64)
    path = model().rollout(
        torch.tensor(TRUTH, dtype=torch.float64).expand(RUNS, -1),
        TensorDict({"qpos": zero, "qvel": zero}, batch_size=(RUNS,)),
        TensorDict({"command": acting}, batch_size=(RUNS, ROWS - 1)),
        torch.arange(1, ROWS, dtype=torch.float64) * STEP,
    )
    position = torch.cat([zero, path["qpos"][..., 0]], 1)
    position = position + NOISE * torch.randn(position.shape, generator=torch.Generator().manual_seed(7)).double()
    time = (torch.arange(ROWS) * STEP).double().numpy()
    table = {
        f"run{r}": {"time": time, "ctrl.motor": command[r, :, 0].numpy(), "qpos.rail": position[r].numpy()}
        for r in range(RUNS)
    }
    return Measurement.from_runs(table, signals=[Signal("qpos.rail", "m", sd=NOISE)], commands=["motor"])


def delayed() -> Identifiable:
    return model().with_effect(ActuatorDelay("motor", Parameter(0.0, 0.1, "s")))


@pytest.mark.slow
@pytest.mark.parametrize("idle", [True, False])
def test_a_model_that_remembers_commands_tells_what_was_before_the_runs(idle: bool) -> None:
    task = prepare(delayed(), log(idle), ["run6"], None, None)
    task, search = begun_as_read(task, UNWATCHED)
    assert task.fit_runs.idle_before == task.held_runs.idle_before == idle
    assert float(search.base.left_out[0].rms.max()) < 1.1
    assert search.base.values["actuator_delay@motor.delay"] == pytest.approx(LATE * STEP, abs=1e-3)


def test_a_model_that_remembers_no_command_asks_nothing() -> None:
    task = prepare(model(), log(idle=True), ["run6"], None, None)
    assert not any(isinstance(one, IdleBefore) for one in task.other_readings(model()))


def test_commands_before_a_run_are_none_or_the_first_rows() -> None:
    held, idle = (make_windows(model(), replace(log(idle=True), idle_before=one), 1.0, MEMORY) for one in (False, True))
    for windows, before in ((held, held.command[:, 0]), (idle, torch.zeros(1))):
        first = windows.first == 0
        assert bool((windows.history[first, -1] == before[first if len(before) > 1 else 0]).all())
        assert torch.equal(windows.history[~first, -1], held.history[~first, -1])
    assert bool(held.history[held.first == 0].all())


@pytest.mark.slow
def test_a_motor_that_is_late_after_idling_is_no_sensor_that_is() -> None:
    """A late sensor was named: what is read late needs no commands before its runs."""
    result = refine(model(), log(idle=True), candidates=TRIED)
    assert (result.verdict, result.accepted) == ("missing_effect", ("actuator_delay@motor",))
    assert max(result.remainder.rms_over_floor.values()) < 1.1
    assert any("before a run's first row" in note for note in result.notes)
