"""Edges of outages that are roughly known, and parts that were none."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.criticism.wiring.outage_edges import disabled, settled
from onlinebayes.criticism.wiring.outages import Outage
from onlinebayes.identification.data.windows import Windows, make_windows
from tests.criticism.wired import NOISE, PENDULUM, STEP

OFF = Outage(("motor",), (("run1", 0.72, 1.31), ("run4", 1.8, 2.6)))
STRETCHES = [(1, 72, 131), (4, 180, 260)]
SECONDS = 1.0


def windows() -> Windows:
    noise = torch.tensor([NOISE], dtype=torch.float64)
    return make_windows(PENDULUM.model(), PENDULUM.measure(off=OFF, runs=5), SECONDS, 0.0, noise)


@pytest.mark.slow
def test_edges_are_settled_beside_theta() -> None:
    """From a theta and edges that are both wrong; what is lost beside an edge is the command's integral up to it."""
    wrong = [(1, 60, 150), (4, 204, 250)]
    theta = torch.tensor([2.0, 0.2], dtype=torch.float64)
    stretches, fitted = settled(wrong, [0], PENDULUM.model(), windows(), theta)
    command = PENDULUM.measure(runs=5).data["command"][..., 0]
    for (run, *edges), (true_run, *true) in zip(stretches, STRETCHES, strict=True):
        assert run == true_run
        for edge, right in zip(edges, true, strict=True):
            lost = command[run, slice(*sorted((edge, right)))].sum() * STEP  # N m s, of 1.2 N m for half a second
            assert abs(float(lost)) < 0.02
            assert abs(edge - right) <= 3
    assert torch.allclose(fitted, torch.tensor(PENDULUM.truth, dtype=torch.float64), rtol=0.01)


@pytest.mark.slow
def test_a_stretch_that_explains_nothing_goes() -> None:
    theta = torch.tensor(PENDULUM.truth, dtype=torch.float64)
    stretches, _ = settled([*STRETCHES, (2, 130, 132)], [0], PENDULUM.model(), windows(), theta)
    assert [run for run, *_ in stretches] == [1, 4]


def test_only_the_rows_of_a_stretch_are_off() -> None:
    on = windows()
    off = disabled(on, [0], STRETCHES).enable
    for w, (run, first) in enumerate(zip(on.run.tolist(), on.first.tolist(), strict=True)):
        for k in range(on.rows):
            within = any(run == r and a <= first + k < b for r, a, b in STRETCHES)
            assert float(off[w, k, 0]) == (0.0 if within else 1.0)
