"""Steps of a fit far from the truth."""

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.findings.left_over import rms_over_floor
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.descent import backtracked
from onlinebayes.identification.fitting.fit import fit
from onlinebayes.identification.fitting.outlying_starts import replayed_misfits
from onlinebayes.identification.fitting.projection import project
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.results import Numerics
from tests.criticism.rigs import TRUTH, measure, model


def test_part_of_the_joint_step_descends_until_nothing_is_left_to_gain() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=4, seconds=2.0), 1.0)
    far = torch.tensor([8.0, 10.0]).double()
    lin = linearise(simulator, windows, far, windows.start)
    projected = project(windows, lin)
    weight = projected.row_weight
    before = replayed_misfits(simulator, windows, weight, far[None], windows.start[None]).sum()
    found = backtracked(simulator, windows, lin, projected)
    assert found is not None
    moved, _ = found
    after = replayed_misfits(simulator, windows, weight, moved.theta[None], moved.starts[None]).sum()
    assert float(after) < 0.5 * float(before)
    best = fit(simulator, windows, torch.tensor(TRUTH).double())
    assert backtracked(simulator, windows, best.lin, best.projected) is None


def test_what_is_left_is_counted_from_the_best_starts() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=4, seconds=2.0), 1.0)
    found = fit(simulator, windows, torch.tensor(TRUTH).double())
    astray = found.lin.starts + 10 * windows.start_sd
    lin = linearise(simulator, windows, found.theta, astray)
    moved = replace(found, lin=lin, projected=project(windows, lin))
    exact = Numerics(simulator.timestep, 0.0, True)
    best, left = (rms_over_floor(one, windows, exact)["qpos.rail"] for one in (found, moved))
    assert left == pytest.approx(best, rel=1e-3)


def test_the_integrators_error_is_floor_only_where_it_cannot_be_helped() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=4, seconds=2.0), 1.0)
    found = fit(simulator, windows, torch.tensor(TRUTH).double())
    noise, chosen, helpless = (
        rms_over_floor(found, windows, Numerics(simulator.timestep, error, sufficient))["qpos.rail"]
        for error, sufficient in ((0.0, True), (5.0, True), (5.0, False))
    )
    # A step that errs by five floors is fine enough for a misfit of fifty: that is fifty floors, not ten.
    assert chosen == noise
    assert helpless == pytest.approx(noise / 5)
