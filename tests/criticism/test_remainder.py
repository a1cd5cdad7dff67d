"""What a fit leaves, over the floor."""

from dataclasses import replace

import pytest
import torch

from onlinebayes.criticism.findings.remainder import rms_over_floor
from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.fit import weighed_by_noise
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.projection import project
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.results import Numerics
from tests.criticism.rigs import TRUTH, measure, model


def test_what_is_left_is_counted_from_the_best_starts() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=4, seconds=2.0), 1.0)
    found = weighed_by_noise(fit(simulator, windows, torch.tensor(TRUTH).double()), windows)
    astray = found.lin.starts + 10 * windows.start_sd
    lin = linearise(simulator, windows, found.theta, astray)
    moved = replace(found, lin=lin, projected=project(windows, lin))
    exact = Numerics(simulator.timestep, 0.0, True)
    best, left = (rms_over_floor(one, windows, exact)["qpos.rail"] for one in (found, moved))
    assert left == pytest.approx(best, rel=1e-3)


def test_the_integrators_error_is_floor_only_where_it_cannot_be_helped() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=4, seconds=2.0), 1.0)
    found = weighed_by_noise(fit(simulator, windows, torch.tensor(TRUTH).double()), windows)
    noise, chosen, helpless = (
        rms_over_floor(found, windows, Numerics(simulator.timestep, error, sufficient))["qpos.rail"]
        for error, sufficient in ((0.0, True), (5.0, True), (5.0, False))
    )
    # A step that errs by five floors is fine enough for a misfit of fifty: that is fifty floors, not ten.
    assert chosen == noise
    assert helpless == pytest.approx(noise / 5)
