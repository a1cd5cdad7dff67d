"""What is different in a held-out run in which the model errs far more than where it was fitted."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from onlinebayes.criticism import compare
from onlinebayes.criticism.findings.new_ground import Reach, new_ground_notes, reaches
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.results import ReplayedRun
from onlinebayes.measurements import Measurement, Signal
from tests.criticism.rigs import NOISE, TRUTH, commands, measure, model

UNITS, FLOORS = {"qpos.arm": "rad"}, {"qpos.arm": 0.001}
FITTED = {
    "slow": Reach({"motor": 1.3}, {"arm": 2.0}, {"arm": (-0.5, 0.8)}),
    "slower": Reach({"motor": 1.0}, {"arm": 2.5}, {"arm": (-0.7, 0.3)}),
}


def replayed(run: str, error: float, held_out: bool = True) -> ReplayedRun:
    """A run at rest that the model misses by so much."""
    zero = torch.zeros(4, 1, dtype=torch.float64)
    return ReplayedRun(run, held_out, zero[:, 0], zero, zero, zero + error, zero, torch.zeros(4, dtype=torch.long))


def notes(error: float, went: Reach) -> tuple[str, ...]:
    replays = (replayed("slow", 0.001, False), replayed("slower", 0.001, False), replayed("hard", error))
    return new_ground_notes(replays, FITTED, {"hard": went}, FLOORS, UNITS)


def test_a_command_that_no_fit_run_reached_is_named() -> None:
    (note,) = notes(0.115, Reach({"motor": 2.1}, {"arm": 2.6}, {"arm": (-0.7, 0.8)}))
    assert note == (
        "in held-out run “hard” the model errs by 115 mrad in qpos.arm (1.0 mrad in the fit runs), and that run "
        "commands motor up to 2.1 where the fit runs reach 1.3: what acts or limits there was not seen"
    )


def test_speeds_and_positions_are_named_too() -> None:
    (note,) = notes(0.115, Reach({"motor": 1.4}, {"arm": 5.0}, {"arm": (-0.7, 1.2)}))
    assert "moves arm at up to 5.0 rad/s where the fit runs reach 2.5 rad/s and takes arm to 1.2 rad" in note
    assert "where the fit runs stay between -700 mrad and 800 mrad" in note
    assert "motor" not in note
    (note,) = notes(float("nan"), Reach({"motor": 1.4}, {"arm": 2.0}, {"arm": (-1.2, 0.7)}))
    assert "the model diverges in qpos.arm" in note
    assert "takes arm to -1.2 rad" in note


@pytest.mark.parametrize(
    ("error", "went"),
    [
        (0.0018, Reach({"motor": 2.1}, {"arm": 2.6}, {"arm": (-0.7, 0.8)})),  # errs as it does in the fit runs
        (0.115, Reach({"motor": 1.4}, {"arm": 2.6}, {"arm": (-0.75, 0.9)})),  # goes no further by a tenth
        (0.115, Reach({"motor": 1.0}, {"arm": 9.0}, {"arm": (1.0, 1.005)})),  # rests, and its sensor is noisy
    ],
)
def test_nothing_is_said_without_a_difference(error: float, went: Reach) -> None:
    assert notes(error, went) == ()


def test_a_limit_that_no_fit_run_reached_is_told_of_the_held_out_run() -> None:
    """The motor gives no more than the fit runs ask of it; the held-out run asks for twice as much."""
    u = commands(9, 301, 0.01, 0)
    u[8] *= 2.2
    most = float(u[:8].abs().max())
    slide, still = model(), torch.zeros(9, 1, dtype=torch.float64)
    time = 0.01 * torch.arange(301, dtype=torch.float64)
    path = slide.rollout(
        torch.tensor(TRUTH, dtype=torch.float64).expand(9, -1),
        TensorDict({"qpos": still, "qvel": still}, batch_size=(9,)),
        TensorDict({"command": u[:, :-1].clamp(-most, most)}, batch_size=(9, 300)),
        time[1:],
    )
    q = torch.cat([still, path["qpos"][..., 0]], 1)
    q = q + NOISE * torch.randn(q.shape, generator=torch.Generator().manual_seed(3), dtype=q.dtype)
    table = {f"run{r}": {"time": time, "ctrl.motor": u[r, :, 0], "qpos.rail": q[r]} for r in range(9)}
    measurement = Measurement.from_runs(table, signals=[Signal("qpos.rail", "m", sd=NOISE)], commands=["motor"])
    (note,) = compare(slide, measurement, holdout=["run8"]).notes
    assert note.startswith("in held-out run “run8” the model errs by ")
    assert "commands motor up to 25 where the fit runs reach 12" in note


def test_how_far_runs_went_is_read_off_what_was_measured() -> None:
    data = measure(runs=2, seconds=2.0)
    found = reaches(make_windows(model(), data, 1.0), ("motor",))
    assert list(found) == ["run0", "run1"]
    for r, reach in enumerate(found.values()):
        position, command = data.data["signal"][r, :, 0], data.data["command"][r, :-1, 0]
        assert reach.command["motor"] == pytest.approx(float(command.abs().max()))
        assert reach.position["rail"] == pytest.approx((float(position.min()), float(position.max())), abs=2e-3)
        assert reach.speed["rail"] == pytest.approx(float(torch.gradient(position)[0].abs().max()) / 0.01, rel=0.1)
