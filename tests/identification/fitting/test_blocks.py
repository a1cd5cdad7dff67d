import pytest
import torch

from onlinebayes.identification.data.windows import Windows, make_windows
from onlinebayes.identification.fitting.blocks import (
    jackknife,
    leave_one_out,
    make_blocks,
    t_quantile,
)
from onlinebayes.identification.fitting.fit import Fit, weighed_by_noise
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.projection import project, start_shift
from onlinebayes.identification.fitting.sensitivities import linearise
from tests.criticism.rigs import FREE, measure, model

START = torch.tensor([4.0, 0.5]).double()


@pytest.fixture(scope="module")
def windows():
    return make_windows(model(), measure(runs=8, seconds=3.0), 1.0)


def test_a_run_is_a_block_from_seven_on(windows) -> None:
    blocks = make_blocks(windows, 0.05)
    assert blocks.count == 8
    assert torch.equal(blocks.of, windows.run)


def test_one_run_is_cut_into_blocks() -> None:
    windows = make_windows(model(), measure(runs=1, seconds=24.0), 1.0)
    blocks = make_blocks(windows, 0.05)
    assert blocks.count == 12
    assert torch.equal(blocks.of, torch.arange(24) // 2)


@pytest.mark.parametrize(("tau", "expected"), [(0.05, 12), (0.5, 12), (0.75, 8), (1.0, 6)])
def test_long_correlation_makes_fewer_blocks(tau: float, expected: int) -> None:
    windows = make_windows(model(), measure(runs=1, seconds=24.0), 1.0)
    assert make_blocks(windows, tau).count == expected


def test_folds_may_be_fewer_never_more(windows) -> None:
    assert make_blocks(windows, 0.05, folds=4).count == 4
    assert make_blocks(windows, 0.05, folds=50).count == 8


def optimum(windows: Windows) -> Fit:
    """The least squares of theta and all starts in sensor noise, to the last digit."""
    simulator, theta, starts = model(), START, windows.start
    for _ in range(8):
        lin = linearise(simulator, windows, theta, starts)
        projected = project(windows, lin)
        C, r = projected.columns.flatten(0, 1), projected.residual.flatten()
        step = torch.linalg.lstsq(C, r[:, None]).solution[:, 0]
        theta, starts = theta + step, starts + start_shift(windows, lin, projected, step)
    return Fit(simulator, lin, projected)


def test_leaving_a_block_out_is_fitting_the_others(windows) -> None:
    fitted = optimum(windows)
    blocks = make_blocks(windows, 0.05)
    without = leave_one_out(fitted, blocks)
    for b in (0, 5):
        others = windows.select((blocks.of != b).nonzero()[:, 0])
        direct = optimum(others)
        moved = (direct.theta - fitted.theta).abs()
        assert torch.allclose(without[b], direct.theta, rtol=0, atol=float(0.03 * moved.max() + 1e-5))


def test_the_jackknife_of_a_mean_is_its_variance() -> None:
    x = torch.randn(10, 1, dtype=torch.float64)
    without = (x.sum(0) - x) / 9
    assert float(jackknife(without)) == pytest.approx(float(x.var() / 10))


def test_t_quantiles() -> None:
    assert t_quantile(0.975, 10) == pytest.approx(2.262, abs=1e-3)


def test_bounds_hold_when_a_block_is_left_out() -> None:
    from onlinebayes.parameters import Parameter, ParameterSpace

    tight = ParameterSpace({**dict(FREE), "joint.rail.damping": Parameter(1.6, 10.0, "N s/m")})  # the truth is 1.4
    windows = make_windows(model(tight), measure(runs=8), 1.0)
    fitted = weighed_by_noise(fit(model(tight), windows, torch.tensor([3.0, 3.0]).double()), windows)
    assert float(fitted.theta[1]) == pytest.approx(1.6)
    assert bool((leave_one_out(fitted, make_blocks(windows, 0.05))[:, 1] >= 1.6).all())
