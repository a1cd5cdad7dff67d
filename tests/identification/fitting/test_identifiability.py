import torch

from onlinebayes.identification.data.windows import make_windows
from onlinebayes.identification.fitting.blocks import Blocks, make_blocks
from onlinebayes.identification.fitting.fit import weighed_by_noise
from onlinebayes.identification.fitting.gauss_newton import fit
from onlinebayes.identification.fitting.identifiability import (
    at_least,
    covariance_of,
    estimates,
    flat_directions,
    noise_covariance,
)
from onlinebayes.parameters import Parameter, ParameterSpace
from tests.criticism.rigs import FREE, TRUTH, measure, model


def test_what_the_data_determine_has_no_flat_direction() -> None:
    windows = make_windows(model(), measure(), 1.0)
    fitted = weighed_by_noise(fit(model(), windows, torch.tensor([4.0, 0.5]).double()), windows)
    assert flat_directions(fitted, windows.bin_step, windows.bin_step) == ()
    blocks = make_blocks(windows, 0.05)
    found = estimates(fitted, covariance_of(fitted, blocks, windows.bin_step, windows.bin_step), blocks.count, ())
    for (_, estimate), truth in zip(found.items(), TRUTH, strict=True):
        assert estimate.identifiable
        # 90 % intervals of two parameters, one seed: within two of them, a false failure is below 1 %.
        assert abs(estimate.mean - truth) < (estimate.q95 - estimate.q05)
        assert 0 < estimate.sd < 0.1 * truth


def test_blocks_that_look_alike_make_nothing_better_known_than_the_noise_allows() -> None:
    windows = make_windows(model(), measure(), 1.0)
    fitted = weighed_by_noise(fit(model(), windows, torch.tensor([4.0, 0.5]).double()), windows)
    least = noise_covariance(fitted, windows.bin_step, windows.bin_step)
    alike = Blocks(torch.zeros_like(windows.run), 2)  # all windows in one block: none is left out but all or nothing
    found = covariance_of(fitted, alike, windows.bin_step, windows.bin_step)
    assert bool((torch.linalg.eigvalsh(found - least) > -1e-9 * least.diagonal().max()).all())
    C = fitted.projected.columns.flatten(0, 1)
    s = fitted.projected.residual.square().sum() / (fitted.projected.row_weight > 0).sum()
    torch.testing.assert_close(least, s * torch.linalg.inv(C.T @ C), rtol=1e-3, atol=0)


def test_at_least_keeps_what_is_larger_and_raises_what_is_less() -> None:
    draw = torch.Generator().manual_seed(0)
    wide, narrow = (
        torch.diag(torch.tensor([4.0, 1.0, 1.0]).double()),
        torch.diag(torch.tensor([1.0, 2.0, 1.0]).double()),
    )
    turn = torch.linalg.qr(torch.randn(3, 3, generator=draw, dtype=torch.float64))[0]
    found = at_least(turn @ wide @ turn.T, turn @ narrow @ turn.T)
    torch.testing.assert_close(found, turn @ torch.diag(torch.tensor([4.0, 2.0, 1.0]).double()) @ turn.T)


def test_mass_damping_and_gear_together_are_one_too_many() -> None:
    space = ParameterSpace({**dict(FREE), "actuator.motor.gear[0]": Parameter(0.3, 3.0, "")})
    windows = make_windows(model(space), measure(), 1.0)
    fitted = weighed_by_noise(fit(model(space), windows, torch.tensor([4.0, 0.5, 1.5]).double()), windows)
    (flat,) = flat_directions(fitted, windows.bin_step, windows.bin_step)
    assert "gear" in flat.description
    blocks = make_blocks(windows, 0.05)
    found = estimates(fitted, covariance_of(fitted, blocks, windows.bin_step, windows.bin_step), blocks.count, (flat,))
    assert not any(estimate.identifiable for name, estimate in found.items() if abs(flat.direction[name]) > 0.35)
    # Only the ratio is known, and it is known well.
    theta = fitted.theta
    assert abs(float(theta[0] / theta[2]) - TRUTH[0]) < 0.05


def test_no_parameters_no_directions() -> None:
    nothing = ParameterSpace()
    windows = make_windows(model(nothing), measure(truth=(), parameters=nothing), 1.0)
    fitted = weighed_by_noise(fit(model(nothing), windows, torch.zeros(0).double()), windows)
    assert flat_directions(fitted, 0.1, 0.01) == ()
    assert estimates(fitted, torch.zeros(0, 0).double(), 5, ()) == {}
