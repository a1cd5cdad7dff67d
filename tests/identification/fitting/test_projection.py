"""Projecting the starts out is joint least squares over theta and all starts: checked against scipy."""

import numpy as np
import torch
from scipy.optimize import least_squares

from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.fit import weighed_by_noise
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.projection import project, signal_rms, start_misfit
from onlinebayes.identification.fitting.sensitivities import linearise
from onlinebayes.identification.replaying.bounded import bounded_least_squares
from onlinebayes.identification.replaying.replay import replay
from tests.criticism.rigs import TRUTH, measure, model


def test_projected_starts_are_joint_least_squares() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=2, seconds=2.0), 1.0)
    W = windows.count

    def rows(x: np.ndarray) -> np.ndarray:
        theta, starts = torch.tensor(x[:2]), torch.tensor(x[2:]).view(W, 2)
        signals, _ = replay(simulator, windows, theta[None], starts[None])
        data = windows.bin(windows.value - signals)[0] / windows.bin_noise
        return torch.cat([data.flatten(), start_misfit(windows, starts).flatten()]).numpy()

    joint = least_squares(rows, np.concatenate([TRUTH, windows.start.flatten().numpy()]), x_scale="jac", xtol=1e-12)
    theta, starts = torch.tensor(joint.x[:2]), torch.tensor(joint.x[2:]).view(W, 2)
    projected = project(windows, linearise(simulator, windows, theta, starts))
    C = projected.columns.flatten(0, 1)
    step = torch.linalg.lstsq(C, projected.residual.flatten()[:, None]).solution[:, 0]
    assert torch.allclose(theta + step, theta, rtol=1e-5)
    assert abs(projected.objective - 2 * joint.cost) < 1e-3 * 2 * joint.cost


def test_a_start_explains_its_own_error() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=2, seconds=2.0, noise=1e-6), 1.0)
    truth = torch.tensor(TRUTH).double()
    right = project(windows, linearise(simulator, windows, truth, windows.start))
    moved = windows.start + 2.0 * windows.start_sd
    wrong = project(windows, linearise(simulator, windows, truth, moved))
    # The prior is 20 sd wide, so that two of them cost (2 / 20)^2 a start at most.
    assert abs(wrong.objective - right.objective) < 2 * windows.count * 0.02


def test_null_residuals_have_the_sensors_size() -> None:
    simulator = model()
    windows = make_windows(simulator, measure(runs=4), 1.0)
    found = weighed_by_noise(fit(simulator, windows, torch.tensor([4.0, 0.5]).double()), windows)
    # 1200 rows: 1 to 2 %, the two fitted starts of a hundred rows taken off.
    assert 0.93 < float(signal_rms(found.projected)) < 1.05


def test_bounded_least_squares() -> None:
    normal = torch.tensor([[2.0, 0.5], [0.5, 1.0]]).double()
    gradient = torch.tensor([1.0, -3.0]).double()
    wide = torch.tensor([10.0, 10.0]).double()
    free = bounded_least_squares(normal, gradient, -wide, wide)
    assert torch.allclose(free, torch.linalg.solve(normal, gradient), atol=1e-6)
    low = torch.tensor([-10.0, 0.0]).double()  # the second may not become negative
    held = bounded_least_squares(normal, gradient, low, wide)
    assert torch.allclose(held, torch.tensor([0.5, 0.0]).double(), atol=1e-6)


def test_a_direction_without_information_stays() -> None:
    normal = torch.tensor([[1.0, 0.0], [0.0, 0.0]]).double()
    step = bounded_least_squares(
        normal, torch.tensor([1.0, 0.0]).double(), -torch.ones(2).double(), torch.full((2,), 5.0).double()
    )
    assert torch.allclose(step, torch.tensor([1.0, 0.0]).double(), atol=1e-6)
    nothing = bounded_least_squares(
        0 * normal, torch.zeros(2).double(), -torch.ones(2).double(), torch.ones(2).double()
    )
    assert torch.equal(nothing, torch.zeros(2).double())
