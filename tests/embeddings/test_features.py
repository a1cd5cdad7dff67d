"""Features of transitions: standardisation, products, residuals, squash."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.embeddings import TransitionFeatures


def _data(count: int = 200) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    observation = torch.randn(count, 3) * torch.tensor([1.0, 100.0, 1e-3]) + 5
    return observation, torch.randn(count, 2), observation + 0.01 * torch.randn(count, 3)


def test_fitted_features_have_mean_zero_and_deviation_one() -> None:
    features = TransitionFeatures(3, 2, squash=False)
    data = _data()
    features.fit(*data)
    z = features(*data)
    assert z.shape == (200, features.size)
    torch.testing.assert_close(z.mean(0), torch.zeros(features.size), atol=1e-4, rtol=0)
    torch.testing.assert_close(z.std(0, correction=0), torch.ones(features.size), atol=1e-3, rtol=0)


def test_squash_is_signed_log() -> None:
    data = _data()
    features = TransitionFeatures(3, 2, squash=True)
    features.fit(*data)
    z, plain = features(*data).split(features.signals, dim=-1)
    torch.testing.assert_close(z, torch.sign(plain) * torch.log1p(plain.abs()))


def test_order_and_values_before_standardisation() -> None:
    o, a, n = torch.tensor([[1.0, 2.0]]), torch.tensor([[3.0]]), torch.tensor([[1.5, 1.0]])
    features = TransitionFeatures(2, 1, squash=False, reference=lambda o, a: (o + 0.25 * a).unsqueeze(0))
    expected = torch.tensor([[1, 2, 3, 0.5, -1, 1.5, -3, -0.25, -1.75, -0.75, -5.25]])
    torch.testing.assert_close(features(o, a, n), torch.cat([expected, expected], -1))
    assert features.signals == expected.shape[-1]
    assert TransitionFeatures(2, 1, products=False).signals == 5


def test_least_squares_sums() -> None:
    J = torch.tensor([[1.0, 2.0], [0.0, 3.0]])  # (P, O)
    steps = torch.cat([torch.zeros(1, 2), J[:1], -J[:1], J[1:], -J[1:]])
    features = TransitionFeatures(2, 1, reference=lambda o, a: o + steps.unsqueeze(1), sensitivities=2)
    o = torch.randn(5, 2)
    n = o + torch.tensor([[0.5, -1.0]])
    features.fit(o, torch.zeros(5, 1), n)
    sums = features(o, torch.zeros(5, 1), n)[0, -features.sums :]
    # W = (1 / .25, 1 / 1): score J W r, then the upper triangle of J W J^T.
    torch.testing.assert_close(sums, torch.tensor([2.0 - 2.0, -3.0, 4.0 + 4.0, 6.0, 9.0]))


def test_sensitivities_need_a_reference_of_the_right_shape() -> None:
    with pytest.raises(ValueError, match="need a reference"):
        TransitionFeatures(2, 1, sensitivities=1)
    features = TransitionFeatures(2, 1, reference=lambda o, a: o.unsqueeze(0), sensitivities=1)
    with pytest.raises(ValueError, match=r"not \(3, 4, 2\)"):
        features(torch.randn(4, 2), torch.randn(4, 1), torch.randn(4, 2))


def test_what_never_varies_is_zero_not_infinite() -> None:
    o, a, n = _data()
    o[:, 0] = n[:, 0] = 0.1
    features = TransitionFeatures(3, 2)
    features.fit(o, a, n)
    z = features(o + 1, a, n)
    assert torch.isfinite(z).all()
    assert (z[:, [0, features.signals]] == 0).all()


def test_masked_steps_do_not_count_in_the_fit() -> None:
    o, a, n = (x.unsqueeze(0) for x in _data())
    mask = torch.arange(200).unsqueeze(0) < 150
    one, other = TransitionFeatures(3, 2), TransitionFeatures(3, 2)
    one.fit(o[:, :150], a[:, :150], n[:, :150])
    o[:, 150:] = float("nan")
    other.fit(o, a, n, mask)
    torch.testing.assert_close(one.mean, other.mean)
    torch.testing.assert_close(one.sd, other.sd)


def test_an_empty_mask_is_refused() -> None:
    o, a, n = (x.unsqueeze(0) for x in _data())
    with pytest.raises(ValueError, match="mask is empty"):
        TransitionFeatures(3, 2).fit(o, a, n, torch.zeros(1, 200, dtype=torch.bool))


def test_a_reference_can_be_replaced() -> None:
    o, a, n = _data()
    features = TransitionFeatures(3, 2, squash=False, reference=lambda o, a: o.unsqueeze(0))
    before = features(o, a, n)[:, : features.signals]
    features.reference = lambda o, a: o.double().unsqueeze(0) + 1
    after = features(o, a, n)[:, : features.signals]
    torch.testing.assert_close(before[:, -9:-6] - 1, after[:, -9:-6], atol=1e-4, rtol=0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_is_the_observations(dtype: torch.dtype) -> None:
    o, a, n = (x.to(dtype) for x in _data())
    assert TransitionFeatures(3, 2)(o, a, n).dtype == dtype


def test_small_differences_of_large_values_survive() -> None:
    # In float32 inputs, 1e3 + 1e-3 resolves; standardising the raw value first would lose it.
    o = torch.full((100, 1), 1000.0) + torch.randn(100, 1)
    n = o + 0.01 * torch.arange(100.0).unsqueeze(1)
    features = TransitionFeatures(1, 1, squash=False)
    features.fit(o, torch.zeros(100, 1), n)
    z = features(o, torch.zeros(100, 1), n)[:, 2]
    assert torch.corrcoef(torch.stack([z, torch.arange(100.0)]))[0, 1] > 0.999


def test_features_of_a_view_are_those_of_what_it_shows() -> None:
    o, a = torch.randn(6, 5, 3), torch.randn(6, 5, 1)
    n = o + 0.1 * torch.randn_like(o)
    seen = TransitionFeatures(2, 1, view=lambda x: x[..., :2] * 10)
    plain = TransitionFeatures(2, 1)
    for features, pair in ((seen, (o, n)), (plain, (o[..., :2] * 10, n[..., :2] * 10))):
        features.fit(pair[0], a, pair[1])
    torch.testing.assert_close(seen(o, a, n), plain(o[..., :2] * 10, a, n[..., :2] * 10))
    with pytest.raises(ValueError, match="a view and a reference"):
        TransitionFeatures(2, 1, view=lambda x: x, reference=lambda o, a: o[None])
