"""Estimator, loss and fit: shapes, keys, gradients, determinism, bad input."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
import torch
from tensordict import TensorDict, pad_sequence

from onlinebayes.embeddings import JoinedEmbedding, LSTMEmbedding, SummaryEmbedding, TransitionFeatures
from onlinebayes.inference import (
    Box,
    BoxUniform,
    MixtureEstimator,
    NeuralPosteriorLoss,
    Posterior,
    TrajectoryKeys,
    fit,
)
from onlinebayes.inference.distributions.normaliser import log_mass_bound, log_mass_in_cube
from onlinebayes.parameters import Parameter, ParameterSpace
from tests.inference.systems import trajectories
from tests.inference.test_distributions import ONE, THREE, TWO

SPACES = [ONE, TWO, THREE]


def _loss(
    space: ParameterSpace, dtype: torch.dtype = torch.float32, keys: TrajectoryKeys | None = None
) -> NeuralPosteriorLoss:
    features = TransitionFeatures(len(space), 1)
    embedding = JoinedEmbedding([LSTMEmbedding(features, hidden=8), SummaryEmbedding(features)])
    estimator = MixtureEstimator(space, embedding.size, components=3, hidden=16)
    return NeuralPosteriorLoss(embedding, estimator, keys).to(dtype)


def _data(space: ParameterSpace, rows: int = 60) -> TensorDict:
    generator = torch.Generator().manual_seed(5)
    return trajectories(BoxUniform(space).sample((rows,), generator), space.to_unit, 0.1, generator)


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_loss_is_a_scalar_and_its_gradient_reaches_every_weight(space: ParameterSpace, dtype: torch.dtype) -> None:
    loss, data = _loss(space, dtype), _data(space)
    loss.standardise(data)
    value = loss(data)["loss_posterior"]
    assert value.shape == ()
    assert value.dtype == dtype
    value.backward()
    for name, weight in loss.named_parameters():
        assert weight.grad is not None, name
        assert torch.isfinite(weight.grad).all(), name
        assert weight.grad.abs().max() > 0, name


def test_the_loss_is_the_mean_negative_log_density_up_to_the_scale() -> None:
    loss, data = _loss(TWO, torch.float64), _data(TWO)
    loss.standardise(data)
    log_prob = Posterior(loss).each(data).log_prob(data["theta"]) - TWO.log_abs_det(data["theta"])
    torch.testing.assert_close(loss(data)["loss_posterior"], -log_prob.mean())


def test_keys_are_said_and_can_be_changed() -> None:
    loss = _loss(TWO)
    assert loss.in_keys == ["observation", "action", ("next", "observation"), "theta"]
    assert loss.out_keys == ["loss_posterior"]
    data = _data(TWO)
    moved = TensorDict(
        {"seen": data["observation"], "done": data["action"], "then": data["next", "observation"], "p": data["theta"]},
        batch_size=data.batch_size,
    )
    keys = TrajectoryKeys("seen", "done", "then", "mask", "p")
    other = _loss(TWO, keys=keys)
    other.load_state_dict(loss.state_dict())
    torch.testing.assert_close(loss(data)["loss_posterior"], other(moved)["loss_posterior"])
    with pytest.raises(ValueError, match="no key 'observation'"):
        loss(moved)


def test_theta_may_be_carried_in_every_step_and_mask_left_out() -> None:
    loss, data = _loss(TWO), _data(TWO)
    expected = loss(data)["loss_posterior"]
    data["theta"] = data["theta"].unsqueeze(1).expand(-1, 4, -1)
    data["mask"] = torch.ones(60, 4, dtype=torch.bool)
    torch.testing.assert_close(loss(data)["loss_posterior"], expected)


def test_masks_are_read_where_torchrl_and_tensordict_put_them() -> None:
    loss, data = _loss(TWO), _data(TWO)
    mask = torch.arange(4) < torch.tensor([2, 3, 4])[torch.arange(60) % 3, None]
    expected = loss(data.clone().set("mask", mask))["loss_posterior"]
    split = data.clone().set(("collector", "mask"), mask)
    torch.testing.assert_close(loss(split)["loss_posterior"], expected)
    # Values of the padding must not matter: a collector pads with zeros.
    split["observation"] = torch.where(mask[..., None], split["observation"], 7.0)
    torch.testing.assert_close(loss(split)["loss_posterior"], expected)


@pytest.mark.parametrize("under", [True, "mask"])
def test_padded_sequences_are_read_without_their_padding(under: bool | str) -> None:
    loss, data = _loss(TWO), _data(TWO)
    lengths = [2 + k % 3 for k in range(60)]
    rows = data.select("observation", "action", ("next", "observation"))
    each = []
    for k, length in enumerate(lengths):
        one = TensorDict({key: rows[k].get(key)[:length] for key in rows.keys(True, True)}, batch_size=[length])
        each.append(one.set("theta", data["theta"][k].expand(length, -1)))
    padded = pad_sequence(each, return_mask=under)
    mask = torch.arange(4) < torch.tensor(lengths)[:, None]
    assert torch.equal(loss.prepare(padded)["mask"], mask)


def test_a_mask_of_another_shape_is_refused() -> None:
    loss, data = _loss(TWO), _data(TWO)
    with pytest.raises(ValueError, match=r"the mask under 'mask' is torch.float32 \(60, 4\)"):
        loss(data.set("mask", torch.ones(60, 4)))


def test_a_value_that_is_not_finite_is_named_unless_masked() -> None:
    loss, data = _loss(TWO), _data(TWO)
    data["observation"] = data["observation"].clone()  # the next observation is a view of the same path
    data["observation"][3, 2, 0] = math.nan
    with pytest.raises(ValueError, match="'observation' is not finite in trajectory 3, step 2"):
        loss(data)
    data["mask"] = torch.ones(60, 4, dtype=torch.bool)
    data["mask"][3, 2:] = False
    assert torch.isfinite(loss(data)["loss_posterior"])


def test_the_estimator_writes_its_keys() -> None:
    estimator = MixtureEstimator(THREE, 10, components=4)
    out = estimator(TensorDict({"embedding": torch.randn(7, 10)}, batch_size=[7]))
    assert [tuple(out[key].shape) for key in estimator.out_keys] == [(7, 4), (7, 4, 3), (7, 4, 3, 3)]
    lower = out["scale_tril"]
    assert (torch.diagonal(lower, dim1=-2, dim2=-1) > 0).all()
    assert (lower.triu(1) == 0).all()
    assert ((out["mean"] >= -0.25) & (out["mean"] <= 1.25)).all()


def test_a_diagonal_estimator_has_no_correlations() -> None:
    loss, data = _loss(TWO), _data(TWO)
    loss.estimator = MixtureEstimator(TWO, loss.embedding.size, components=3, hidden=16, diagonal=True)
    loss(data)["loss_posterior"].backward()
    lower = Posterior(loss).each(data).scale_tril
    assert torch.equal(lower, torch.diag_embed(torch.diagonal(lower, dim1=-2, dim2=-1)))
    assert all(weight.grad is not None for weight in loss.estimator.parameters())


def test_a_fit_lowers_the_loss_and_is_repeatable() -> None:
    reports = []
    for _ in range(2):
        torch.manual_seed(0)
        seen: list[int] = []
        loss = _loss(TWO)
        report = fit(
            loss,
            _data(TWO, 200),
            generator=torch.Generator().manual_seed(0),
            epochs=6,
            progress=lambda e, _, seen=seen: seen.append(e),
        )
        assert seen == list(range(6))
        assert len(report.train) == len(report.validation) == 6
        assert report.validation[report.best] == min(report.validation) < report.validation[0]
        reports.append(report)
    assert reports[0].validation == reports[1].validation
    assert reports[0].widening == reports[1].widening >= 1


def test_a_fit_keeps_the_best_weights() -> None:
    loss, data = _loss(TWO), _data(TWO, 40)
    # So hot that it overfits 36 trajectories at once.
    report = fit(loss, data, generator=torch.Generator().manual_seed(0), epochs=60, learning_rate=3e-2, patience=5)
    assert len(report.validation) == report.best + 6 <= 60


def test_a_time_budget_ends_the_fit() -> None:
    report = fit(_loss(TWO), _data(TWO, 200), generator=torch.Generator().manual_seed(0), epochs=10**6, seconds=0.3)
    assert 0.3 <= report.seconds < 5


def test_too_few_trajectories_are_refused() -> None:
    with pytest.raises(ValueError, match="needs two at least"):
        fit(_loss(TWO), _data(TWO, 1), generator=torch.Generator())


def test_two_trajectories_and_a_constant_signal_are_enough_to_run() -> None:
    data = _data(TWO, 2)
    data["observation"][..., 0] = data["next", "observation"][..., 0] = 1.0
    report = fit(_loss(TWO), data, generator=torch.Generator().manual_seed(0), epochs=3)
    assert all(math.isfinite(value) for value in report.validation)


def test_a_box_moves_the_estimator_without_changing_its_shape() -> None:
    loss, data = _loss(ONE, torch.float64), _data(ONE)
    wide = Posterior(loss).each(data)
    loss.estimator.box = Box(ONE, torch.tensor([0.4]).double(), torch.tensor([0.6]).double())
    narrow = Posterior(loss).each(data)
    z = torch.rand(60, 1, dtype=torch.float64)
    torch.testing.assert_close(wide.log_prob_frame(z), narrow.log_prob_frame(z))
    gain = narrow.log_prob(narrow.box.from_frame(z)) - wide.log_prob(wide.box.from_frame(z))
    torch.testing.assert_close(gain, torch.full_like(gain, math.log(5)))


def test_a_log_parameter_is_learnt_on_its_logarithm() -> None:
    space = ParameterSpace({"k": Parameter(1e-3, 1e3, "N/m", "log")})
    torch.manual_seed(0)
    loss, data = _loss(space), _data(space, 600)
    fit(loss, data, generator=torch.Generator().manual_seed(0), epochs=15)
    for value in (3e-3, 300.0):
        theta = torch.full((1, 1), value, dtype=torch.float64)
        seen = trajectories(theta, space.to_unit, 0.1, torch.Generator().manual_seed(9))
        low, high = Posterior(loss).condition(seen).quantiles([0.02, 0.98])[:, 0].tolist()
        assert low < value * 3
        assert high > value / 3
        assert high / low < 1e3


def test_the_fast_loss_is_an_upper_bound_and_exact_for_one_parameter() -> None:
    for space in (ONE, TWO):
        loss, data = _loss(space, torch.float64), _data(space)
        loss.standardise(data)
        rows = loss.prepare(data)
        above = loss.each(rows, exact=False) - loss.each(rows)
        assert above.min() > -1e-9
        if len(space) == 1:
            torch.testing.assert_close(above, torch.zeros_like(above))


def test_the_bound_of_a_mass_holds_whatever_the_correlations() -> None:
    generator = torch.Generator().manual_seed(0)
    for size in (1, 2, 3):
        mean = 3 * torch.rand(500, size, generator=generator, dtype=torch.float64) - 1
        lower = torch.randn(500, size, size, generator=generator, dtype=torch.float64).tril()
        lower.diagonal(dim1=-2, dim2=-1).abs_().add_(0.05)
        bound, exact = log_mass_bound(mean, lower), log_mass_in_cube(mean, lower)
        likely = exact > -7  # integrals by quadrature are less exact far out
        assert (bound - exact)[likely].min() > -1e-3


@pytest.mark.parametrize(("rows", "steps"), [(20, 9), (450, 9), (4000, 36)])
def test_few_trajectories_make_small_batches(rows: int, steps: int, monkeypatch: pytest.MonkeyPatch) -> None:
    loss, data = _loss(ONE), _data(ONE, rows)
    taken: list[int] = []
    each = NeuralPosteriorLoss.each

    def counted(self: NeuralPosteriorLoss, prepared: Mapping[str, torch.Tensor], **exact: bool) -> torch.Tensor:
        taken.append(torch.is_grad_enabled())
        return each(self, prepared, **exact)

    monkeypatch.setattr(NeuralPosteriorLoss, "each", counted)
    fit(loss, data, generator=torch.Generator().manual_seed(0), epochs=1)
    assert sum(taken) == steps
