"""Known starts: the truth is recovered where free starts hide it, a given sd is kept, nonsense is refused."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
import torch
from torch import Tensor

from onlinebayes.identification.data.start_priors import START_LOOSENESS, start_coordinates
from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.gauss_newton import Fitted, fit
from onlinebayes.measurements import KnownStart, Measurement, Signal
from onlinebayes.parameters import Parameter, ParameterSpace
from onlinebayes.runs import BadInput
from tests.slide import Slide

RUNS, SECONDS, STEP, NOISE, GAIN = 24, 1.0, 0.1, 0.05, 1.3
FREE = Slide(ParameterSpace({"gain": Parameter(0.5, 2.5, "1/kg")}))


def runs(start: Tensor, gain: float = GAIN, seed: int = 0) -> Measurement:
    """A constant force a run on a mass that begins at 0 with some speed (RUNS,), seen by a position sensor of 5 cm."""
    draw = torch.Generator().manual_seed(seed)
    t = STEP * torch.arange(round(SECONDS / STEP) + 1, dtype=torch.float64)
    u = torch.linspace(1.5, 2.5, RUNS, dtype=torch.float64) * (-1.0) ** torch.arange(RUNS)
    q = start[:, None] * t + 0.5 * gain * u[:, None] * t * (t + STEP)  # the torch systems' semi-implicit step
    q = q + NOISE * torch.randn(q.shape, generator=draw, dtype=torch.float64)
    columns: dict[str, Mapping[str, Tensor]] = {
        f"r{k:02d}": {"time": t, "ctrl.motor": u[k].expand(len(t)), "qpos.rail": q[k]} for k in range(RUNS)
    }
    return Measurement.from_runs(columns, signals=[Signal("qpos.rail", "m", sd=NOISE)])


def fitted(measurement: Measurement) -> tuple[Windows, Fitted]:
    windows = make_windows(FREE, measurement, SECONDS)
    return windows, fit(FREE, windows, FREE.nominal)


REST = {"qpos.rail": KnownStart(0.0), "qvel.rail": KnownStart(0.0)}


def test_known_rest_recovers_what_free_starts_hide() -> None:
    """With starts known the gain's standard error is 0.01, with free ones 0.06: within four of them (1 in 15 000)."""
    still = runs(torch.zeros(RUNS).double())
    windows, known = fitted(still.with_starts(REST))
    assert abs(float(known.theta) - GAIN) < 0.04
    assert bool((known.lin.starts == 0).all())
    assert not bool(windows.free_starts.any())
    _, free = fitted(still)
    spread = [float(one.rows.columns.flatten(0, 1).norm()) for one in (known, free)]
    assert spread[0] > 3 * spread[1]  # the information that a log holds


def test_a_given_sd_is_that_of_the_fitted_starts() -> None:
    """The starts are those of least squares with the prior's row, worked out by hand: it halves them."""
    sd, draw = 0.03, torch.Generator().manual_seed(1)
    moving = runs(sd * torch.randn(RUNS, generator=draw, dtype=torch.float64))
    windows, found = fitted(moving.with_starts({"qpos.rail": KnownStart(0.0), "qvel.rail": KnownStart(0.0, sd)}))
    t = STEP * torch.arange(1, windows.rows + 1, dtype=torch.float64)
    left = windows.value[..., 0] - 0.5 * float(found.theta) * windows.command[:, :1, 0] * t * (t + STEP)
    row, prior = found.rows.weight[:, 0].square(), found.rows.prior_weight[0, 1].square()
    by_hand = (left @ (row * t)) / NOISE**2 / ((row * t) @ t / NOISE**2 + prior / sd**2)
    assert float((found.lin.starts[:, 1] - by_hand).abs().max()) < 0.02 * sd
    # Where the model leaves noise alone the prior's row counts as much as a measured one: 240 rows, 10 % (1 in 100).
    assert float(prior / row.mean()) == pytest.approx(1.0, abs=0.15)


def test_a_wrong_model_does_not_loosen_what_is_known() -> None:
    """Without a gain of its own the model errs by twenty times the noise; the starts stay within what was given."""
    stiff = Slide(ParameterSpace({"gain": Parameter(0.5, 0.5001, "1/kg")}))
    errs = runs(torch.zeros(RUNS).double(), gain=2.4)
    sd = 0.02
    moved = []
    for starts in (REST | {"qvel.rail": KnownStart(0.0, sd)}, {}):
        windows = make_windows(stiff, errs.with_starts(starts), SECONDS)
        moved.append(float(fit(stiff, windows, stiff.nominal).lin.starts[:, 1].abs().max()))
    assert moved[0] < 3 * sd
    assert moved[1] > 30 * sd


def test_a_value_holds_where_a_run_begins_and_an_sd_in_every_window() -> None:
    long = runs(torch.zeros(RUNS).double())
    windows = make_windows(FREE, long.with_starts({"qvel.rail": KnownStart(0.0, 0.01)}), SECONDS / 2)
    begins = windows.first == 0
    assert bool(begins.any())
    assert not bool(begins.all())
    assert torch.equal(windows.start_given, torch.stack([torch.zeros_like(begins), begins], 1))
    assert bool((windows.start[begins, 1] == 0).all())
    assert bool((windows.start_prior[begins, 1] == 0.01).all())
    loose = make_windows(FREE, long, SECONDS / 2)
    assert torch.equal(windows.start[~begins], loose.start[~begins])
    assert torch.equal(loose.start_prior, START_LOOSENESS * loose.start_sd)
    every = make_windows(FREE, long.with_starts({"qvel.rail": KnownStart(sd=0.3)}), SECONDS / 2)
    assert torch.equal(every.start, loose.start)
    assert bool((every.start_prior[:, 1] == 0.3).all())


def test_a_part_of_a_run_does_not_begin_where_the_run_does() -> None:
    known = runs(torch.zeros(RUNS).double()).with_starts(
        {"qvel.rail": KnownStart(0.0), "qpos.rail": KnownStart(sd=0.1)}
    )
    assert known.rows("r00", 0, 5).starts == known.starts
    assert known.rows("r00", 5, 10).starts == {"qpos.rail": KnownStart(sd=0.1)}
    assert known.after(0.2).starts == known.starts
    assert known.select(["r03"]).starts == known.starts


def test_nonsense_is_refused() -> None:
    with pytest.raises(BadInput, match="neither a value nor an sd"):
        KnownStart()
    with pytest.raises(BadInput, match="no standard deviation"):
        KnownStart(0.0, -1.0)
    with pytest.raises(BadInput, match="not finite"):
        KnownStart(float("nan"))
    wrong = runs(torch.zeros(RUNS).double()).with_starts({"qvel.rial": KnownStart(0.0)})
    with pytest.raises(BadInput, match=r"no coordinate 'qvel\.rial'; nearest: qvel\.rail"):
        make_windows(FREE, wrong, SECONDS)


def test_coordinates_of_a_free_joint_are_turns() -> None:
    signals = [*(f"qpos.base.{k}" for k in range(7)), "qpos.lift", *(f"qvel.base.{k}" for k in range(6)), "qvel.lift"]
    assert start_coordinates(signals) == (
        *("qpos.base.0", "qpos.base.1", "qpos.base.2", "qpos.base.rx", "qpos.base.ry", "qpos.base.rz", "qpos.lift"),
        *("qvel.base.0", "qvel.base.1", "qvel.base.2", "qvel.base.3", "qvel.base.4", "qvel.base.5", "qvel.lift"),
    )
