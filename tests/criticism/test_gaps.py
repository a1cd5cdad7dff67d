"""A log that lacks rows: one that lost them and one that has none there are told apart, and neither is accused."""

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import begun_as_read, prepare, refine
from onlinebayes.identification.data.lost_rows import rows_missing
from onlinebayes.measurements import Measurement, Signal
from onlinebayes.runs import UNWATCHED
from tests.criticism.rigs import NOISE, TRUTH, commands, model

RUNS, ROWS, STEP = 8, 301, 0.01
LATE = ["actuator_delay", "actuator_lag", "sensor_delay", "dry_friction"]


def log(held: bool) -> Measurement:
    """Three of ten rows are missing, in which nothing was told (held), or one of thirty, in which something was."""
    there = torch.rand(RUNS, ROWS, generator=torch.Generator().manual_seed(5)) > (0.3 if held else 1 / 30)
    there[:, :2] = True
    command = commands(RUNS, ROWS, STEP, seed=3)
    if held:
        last = torch.where(there, torch.arange(ROWS), 0).cummax(1).values
        command = command.gather(1, last[..., None])
    zero = torch.zeros(RUNS, 1, dtype=torch.float64)
    path = model().rollout(
        torch.tensor(TRUTH, dtype=torch.float64).expand(RUNS, -1),
        TensorDict({"qpos": zero, "qvel": zero}, batch_size=(RUNS,)),
        TensorDict({"command": command[:, :-1]}, batch_size=(RUNS, ROWS - 1)),
        torch.arange(1, ROWS, dtype=torch.float64) * STEP,
    )
    position = torch.cat([zero, path["qpos"][..., 0]], 1)
    position = position + NOISE * torch.randn(position.shape, generator=torch.Generator().manual_seed(7)).double()
    time = (torch.arange(ROWS) * STEP).double()
    table = {
        f"run{r}": {
            "time": time[rows].numpy(),
            "ctrl.motor": command[r, rows, 0].numpy(),
            "qpos.rail": position[r, rows].numpy(),
        }
        for r, rows in enumerate(there)
    }
    return Measurement.from_runs(table, signals=[Signal("qpos.rail", "m", sd=NOISE)], commands=["motor"])


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
def test_the_base_model_tells_how_commands_go_through_gaps(held: bool) -> None:
    task, search = begun_as_read(prepare(model(), log(held), ["run7"], None, None), UNWATCHED)
    assert task.fit_runs.held_over_gaps == task.held_runs.held_over_gaps == held
    assert float(search.base.left_out[0].rms.max()) < 1.1


@pytest.mark.long
@pytest.mark.parametrize("held", [True, False])
def test_a_right_model_is_right_whichever_way_its_log_has_gaps(held: bool) -> None:
    measurement = log(held)
    assert rows_missing(measurement) > (500 if held else 50)
    result = refine(model(), measurement, candidates=LATE)
    assert (result.verdict, result.accepted) == ("adequate", ())
    assert any("missing in the log" in note for note in result.notes)
    assert any("held until the next row" in note for note in result.notes) == held
