"""Every embedding: ragged lengths, padding that may hold anything, step by step as at once."""

from __future__ import annotations

import pytest
import torch

from onlinebayes.embeddings import (
    AttentionEmbedding,
    Embedding,
    GRUEmbedding,
    JoinedEmbedding,
    LSTMEmbedding,
    PooledEmbedding,
    StatisticsEmbedding,
    StepwiseEmbedding,
    SummaryEmbedding,
    TransitionFeatures,
)

LENGTHS = torch.tensor([7, 1, 4, 0])
TRAINED = ["lstm", "gru", "attention"]
KINDS = [*TRAINED, "summary", "statistics", "joined", "pooled"]
STEPWISE = [kind for kind in KINDS if kind not in ("attention", "pooled")]


def _reference(o: torch.Tensor, a: torch.Tensor) -> torch.Tensor:
    """One parameter that bends the second signal."""
    return torch.stack([o, o + 0.3 * o[..., :1], o - 0.3 * o[..., :1]])


def _embedding(kind: str, dtype: torch.dtype = torch.float64) -> Embedding:
    features = TransitionFeatures(3, 2, reference=_reference, sensitivities=1)
    makers = {
        "lstm": lambda: LSTMEmbedding(features, hidden=8),
        "gru": lambda: GRUEmbedding(features, hidden=8),
        "attention": lambda: AttentionEmbedding(features, width=8, heads=2, layers=2),
        "summary": lambda: SummaryEmbedding(features),
        "statistics": lambda: StatisticsEmbedding(features),
        "pooled": lambda: PooledEmbedding(LSTMEmbedding(features, hidden=8)),
        "joined": lambda: JoinedEmbedding([LSTMEmbedding(features, hidden=8), SummaryEmbedding(features)]),
    }
    made: Embedding = makers[kind]().to(dtype)
    made.fit(*_batch(dtype))
    return made


def _batch(dtype: torch.dtype = torch.float64) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
    o, a = torch.randn(4, 7, 3, dtype=dtype), torch.randn(4, 7, 2, dtype=dtype)
    return o, a, o + 0.1 * torch.randn(4, 7, 3, dtype=dtype), torch.arange(7) < LENGTHS.unsqueeze(1)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_shape_and_dtype(kind: str, dtype: torch.dtype) -> None:
    embedding = _embedding(kind, dtype)
    vector = embedding(*_batch(dtype))
    assert vector.shape == (4, embedding.size)
    assert vector.dtype == dtype
    assert torch.isfinite(vector).all()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("garbage", [float("nan"), float("inf"), -1e30, 17.0])
def test_padding_never_leaks(kind: str, garbage: float) -> None:
    embedding, (o, a, n, mask) = _embedding(kind), _batch()
    clean = embedding(o, a, n, mask)
    for x in (o, a, n):
        x[~mask] = garbage
    dirty = embedding(o, a, n, mask)
    assert torch.equal(clean, dirty)
    embedding.fit(o, a, n, mask)
    assert all(torch.isfinite(b).all() for b in embedding.buffers())
    if any(True for _ in embedding.parameters()):
        dirty.square().sum().backward()
    for name, weight in embedding.named_parameters():
        assert weight.grad is not None, name
        assert torch.isfinite(weight.grad).all(), name


@pytest.mark.parametrize("kind", KINDS)
def test_ragged_rows_equal_their_own_cut_trajectories(kind: str) -> None:
    embedding, (o, a, n, mask) = _embedding(kind), _batch()
    together = embedding(o, a, n, mask)
    for row, length in enumerate(LENGTHS[:3].tolist()):
        alone = embedding(o[row : row + 1, :length], a[row : row + 1, :length], n[row : row + 1, :length])
        torch.testing.assert_close(together[row : row + 1], alone)
    assert (together[3] == 0).all()


@pytest.mark.parametrize("kind", STEPWISE)
@pytest.mark.parametrize(("dtype", "tolerance"), [(torch.float32, 1e-4), (torch.float64, 1e-9)])
def test_step_by_step_equals_at_once(kind: str, dtype: torch.dtype, tolerance: float) -> None:
    embedding, (o, a, n, _) = _embedding(kind, dtype), _batch(dtype)
    assert isinstance(embedding, StepwiseEmbedding)
    state = embedding.initial(4)
    assert state.shape == (4, embedding.state_size)
    assert state.dtype == dtype
    for t in range(7):
        vector, state = embedding.step(embedding.features(o[:, t], a[:, t], n[:, t]), state)
        whole = embedding(o[:, : t + 1], a[:, : t + 1], n[:, : t + 1])
        torch.testing.assert_close(vector, whole, rtol=tolerance, atol=tolerance)


@pytest.mark.parametrize("kind", KINDS)
def test_a_mask_with_a_gap_is_refused(kind: str) -> None:
    embedding, (o, a, n, mask) = _embedding(kind), _batch()
    mask[0, 2] = False
    with pytest.raises(ValueError, match="behind a padded one"):
        embedding(o, a, n, mask)


@pytest.mark.parametrize("kind", TRAINED)
def test_order_matters_and_every_weight_gets_a_gradient(kind: str) -> None:
    embedding, (o, a, n, _) = _embedding(kind), _batch()
    forth, back = embedding(o, a, n), embedding(o.flip(1), a.flip(1), n.flip(1))
    assert (forth - back).abs().max() > 1e-3
    forth.square().sum().backward()
    for name, weight in embedding.named_parameters():
        assert weight.grad is not None, name
        assert weight.grad.abs().max() > 0, name


@pytest.mark.parametrize("kind", KINDS)
def test_scales_travel_with_the_state_dict(kind: str) -> None:
    one, other, batch = _embedding(kind), _embedding(kind), _batch()
    other.load_state_dict(one.state_dict())
    torch.testing.assert_close(one(*batch), other(*batch))


def test_the_least_squares_step_finds_the_parameter() -> None:
    # o' = o + x .3 o_1 on every signal: delta must be x, whatever x and however long the trajectory.
    x = torch.linspace(-1, 1, 20, dtype=torch.float64)[:, None, None]
    o = torch.randn(20, 9, 3, dtype=torch.float64)
    mask = torch.arange(9) < torch.arange(20).unsqueeze(1) % 9 + 1
    embedding = SummaryEmbedding(
        TransitionFeatures(3, 2, reference=_reference, sensitivities=1), averages=False
    ).double()
    data = o, torch.zeros(20, 9, 2, dtype=torch.float64), o + x * 0.3 * o[..., :1], mask
    embedding.fit(*data)
    e = embedding(*data)[:, 0]
    standard = 3 * torch.sinh(e / 3)
    torch.testing.assert_close(standard * x.std(correction=0) + x.mean(), x[:, 0, 0], atol=1e-5, rtol=0)


def test_the_statistics_are_those_of_bayessim() -> None:
    o, a, n, mask = _batch()
    o, a, n, mask = o[:3], a[:3], n[:3], mask[:3]
    embedding = StatisticsEmbedding(TransitionFeatures(3, 2)).double()
    embedding.fit(o, a, n, mask)
    rows = []
    for row, length in enumerate(LENGTHS[:3].tolist()):
        d, u = (n - o)[row, :length], a[row, :length]
        products = torch.einsum("tj,ti->ji", u, d).flatten() / length
        rows.append(torch.cat([products, d.mean(0), d.std(0, correction=0)]))
    x = torch.stack(rows)
    expected = 3 * torch.asinh((x - x.mean(0)) / x.std(0, correction=0) / 3)
    torch.testing.assert_close(embedding(o, a, n, mask), expected)


def test_running_statistics_keep_a_small_spread_about_a_large_mean() -> None:
    """In single precision sums of squares would lose it."""
    o, a, n, _ = _batch(torch.float32)
    n = o + 1 + torch.linspace(0, 1, 4)[:, None, None] + 1e-3 * torch.randn(4, 7, 3)
    embedding = StatisticsEmbedding(TransitionFeatures(3, 2))
    embedding.fit(o, a, n, torch.ones(4, 7, dtype=torch.bool))
    state = embedding.initial(4)
    for t in range(7):
        vector, state = embedding.step(embedding.features(o[:, t], a[:, t], n[:, t]), state)
    torch.testing.assert_close(vector, embedding(o, a, n), rtol=1e-2, atol=1e-2)


def test_joining_needs_one_features_object() -> None:
    one, other = (LSTMEmbedding(TransitionFeatures(3, 2), hidden=4) for _ in range(2))
    with pytest.raises(ValueError, match="same features object"):
        JoinedEmbedding([one, other])
    with pytest.raises(ValueError, match="at least one"):
        JoinedEmbedding([])
    with pytest.raises(ValueError, match="nothing to summarise"):
        SummaryEmbedding(one.features, averages=False)
    with pytest.raises(ValueError, match="give features products=True"):
        StatisticsEmbedding(TransitionFeatures(3, 2, products=False))
    with pytest.raises(ValueError, match="needs a multiple of 8"):
        AttentionEmbedding(one.features, width=12)


@pytest.mark.gpu
@pytest.mark.parametrize("kind", KINDS)
def test_on_a_gpu_it_gives_the_same(kind: str) -> None:
    embedding, batch = _embedding(kind), _batch()
    expected = embedding(*batch)
    result = embedding.cuda()(*(x.cuda() for x in batch))
    assert result.device.type == "cuda"
    torch.testing.assert_close(result.cpu(), expected)
