"""Runs of different lengths become one rectangle whose padding is told apart, and what is wrong is named."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from onlinebayes.measurements import Measurement, Signal, concatenate
from onlinebayes.runs import BadInput

NAN = float("nan")


def two_runs() -> Measurement:
    return Measurement.from_runs(
        {
            "a": {"time": [0.0, 0.1, 0.2], "ctrl.motor": [1.0, 1.0, 2.0], "qpos.x": [0.0, NAN, 0.3]},
            "b": {"time": [5.0, 5.5], "ctrl.motor": [0.0, 0.0], "qpos.x": [1.0, 1.0], "qvel.x": [0.0, 0.5]},
        }
    )


def test_the_beginning_of_every_run_may_be_left_out() -> None:
    runs = {"a": np.arange(0.0, 1.0, 0.1), "b": 5.0 + np.arange(0.0, 0.5, 0.1)}
    whole = Measurement.from_runs({name: {"time": t, "qpos.x": t} for name, t in runs.items()})
    late = whole.after(0.25)
    assert late.lengths.tolist() == [7, 2]
    assert late.data["time"][:, 0].tolist() == pytest.approx([0.3, 5.3])
    assert late.data["signal"][0, :, 0].tolist() == pytest.approx(runs["a"][3:].tolist())
    assert torch.equal(whole.after(0.0).data["signal"], whole.data["signal"])
    with pytest.raises(BadInput, match=r"run 'b' has nothing after its first 0\.4 s"):
        whole.after(0.4)


def test_runs_are_padded_and_told_apart():
    m = two_runs()
    assert m.runs == ("a", "b")
    assert m.commands == ("motor",)
    assert [s.name for s in m.signals] == ["qpos.x", "qvel.x"]
    assert m.data.batch_size == (2, 3)
    assert m.lengths.tolist() == [3, 2]
    assert m.durations == pytest.approx((0.2, 0.5))
    assert m.data["mask"].tolist() == [[True, True, True], [True, True, False]]
    assert m.data["time"][1].tolist() == [5.0, 5.5, 6.0]
    assert m.data["command"][0, :, 0].tolist() == [1.0, 1.0, 2.0]
    assert m.data["measured"][0].tolist() == [[True, False], [False, False], [True, False]]
    assert not m.data["measured"][1, 2].any()
    assert bool(torch.isfinite(m.data["signal"]).all())
    assert m.data["enable"].unique().tolist() == [1.0]
    assert m.data["time"].dtype == torch.float64


def test_select_drops_padding_and_keeps_order():
    m = two_runs()
    assert m.select(["b"]).data.batch_size == (1, 2)
    assert m.select(["b", "a"]).runs == ("b", "a")
    assert m.select(["b", "a"]).data["time"][1].tolist() == m.data["time"][0].tolist()
    with pytest.raises(BadInput, match="run 'c' is unknown; known: a, b"):
        m.select(["c"])
    with pytest.raises(BadInput, match="no run"):
        m.select([])


def test_concatenate_is_the_inverse_of_select():
    m = two_runs()
    again = concatenate([m.select(["a"]), m.select(["b"])])
    assert again.runs == m.runs
    assert bool((again.data == m.data).all())
    with pytest.raises(BadInput, match="run 'a' stands in two"):
        concatenate([m, m])


def test_signals_carry_their_noise():
    m = two_runs().with_signals([Signal("qpos.x", "m", sd=1e-3)])
    assert m.signals == (Signal("qpos.x", "m", sd=1e-3), Signal("qvel.x"))
    for bad in (0.0, -1.0, NAN, float("inf")):
        with pytest.raises(BadInput, match="not a positive number"):
            Signal("qpos.x", sd=bad)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"ctrl.u": [0.0, 0.0]}, "no column 'time'"),
        ({"time": []}, "a run of 0 rows"),
        ({"time": [0.0]}, "row 1: a run of 1 row; give two or more"),
        ({"time": [0.0, 1.0], "qpos.x": [0.0]}, r"column 'qpos.x' has shape \(1,\)"),
        ({"time": [0.0, 1.0, 1.0]}, "row 3, column .time.: time goes from 1 to 1 s"),
        ({"time": [0.0, NAN, 1.0]}, "row 2, column .time.: the time cannot be nan"),
        ({"time": [0.0, 1.0], "qpos.x": [0.0, np.inf]}, "row 2, column 'qpos.x': inf"),
        ({"time": [0.0, 1.0], "ctrl.u": [NAN, 1.0]}, "row 1, column 'ctrl.u': a command cannot be nan"),
    ],
)
def test_bad_runs_are_named(columns, message):
    with pytest.raises(BadInput, match=message):
        Measurement.from_runs({"a": columns})


def test_a_command_may_be_left_out_only_where_the_actuator_is_off():
    time = {"time": [0.0, 1.0], "qpos.x": [0.0, 0.0]}
    with pytest.raises(BadInput, match=r"no column 'ctrl\.u'"):
        Measurement.from_runs({"a": time}, commands=["u"])
    off = Measurement.from_runs({"a": {**time, "enable.u": [0.0, 0.0]}}, commands=["u"])
    assert off.data["enable"].unique().tolist() == [0.0]
    assert off.data["command"].unique().tolist() == [0.0]


def test_some_rows_of_a_run_are_a_run_of_their_own():
    part = two_runs().rows("a", 1, 3, name="a (end)")
    assert part.runs == ("a (end)",)
    assert part.data["time"].tolist() == [[0.1, 0.2]]
    assert part.data["mask"].all()
    assert part.to("cpu").data.device == torch.device("cpu")


def test_what_does_not_fit_together_is_refused():
    m = two_runs()
    with pytest.raises(ValueError, match="2 runs are named"):
        Measurement(m.data[:1], m.signals, m.commands, m.runs)
    with pytest.raises(ValueError, match="'command' has shape"):
        Measurement(m.data, m.signals, ("motor", "brake"), m.runs)
    with pytest.raises(ValueError, match="run names repeat"):
        Measurement(m.data, m.signals, m.commands, ("a", "a"))
    with pytest.raises(ValueError, match="differ in their signals"):
        concatenate([m.select(["a"]), m.select(["b"]).with_signals([Signal("qpos.x", "m")])])
    with pytest.raises(BadInput, match="no runs"):
        Measurement.from_runs({})
