"""Which joints move in a window: those that travel, and beside others those that creep within their sensor's noise."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from onlinebayes.identification.data.grid import run_grids
from onlinebayes.identification.data.starts import window_starts
from onlinebayes.measurements import Measurement

STEP, ROWS, NOISE = 0.01, 101, 1e-3


def moves(creep: float, beside: bool, seed: int = 0) -> list[bool]:
    """Of windows in which a joint creeps by so many sd, whether it moves; with a second joint that travels or alone."""
    draw, time = np.random.default_rng(seed), STEP * np.arange(ROWS)
    runs = {}
    for number in range(20):
        slow = creep * NOISE * time / time[-1] + NOISE * draw.normal(size=ROWS)
        runs[f"run{number}"] = {"time": time, "ctrl.motor": time, "qpos.ball": slow}
        if beside:
            runs[f"run{number}"]["qpos.beam"] = np.sin(6 * time)
    measurement = Measurement.from_runs(runs)
    names = [signal.name for signal in measurement.signals]
    joints = ["ball", "beam"] if beside else ["ball"]
    cuts = [(run, 0.0, time[-1]) for run in range(20)]
    noise = torch.full((len(names),), NOISE, dtype=torch.float64)
    grids = run_grids(measurement, STEP)
    return window_starts(grids, cuts, names, joints, noise)[2][:, 0].tolist()


@pytest.mark.parametrize(("creep", "beside", "moving"), [(2.5, True, {20}), (0.0, True, {0, 1}), (2.0, False, {0})])
def test_what_creeps_beside_another_joint_moves(creep: float, beside: bool, moving: set[int]) -> None:
    """One rest in 140 is called a creep: with another seed, two or more of 20 with probability 1 %."""
    assert sum(moves(creep, beside)) in moving


def test_what_travels_moves() -> None:
    assert all(moves(20.0, False))
