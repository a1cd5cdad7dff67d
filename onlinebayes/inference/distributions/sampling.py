"""Draws from Gaussians truncated to the unit cube: inside always, and never an endless loop.

P = 1 is drawn by inverting the distribution function. Otherwise plain rejection first (exact; most components lie
mostly inside), a bounded number of tries; rows still outside take a start from Genz's separation of variables,
importance-resampled (exact as the number of candidates grows), and then sweeps of Gibbs sampling, each coordinate from
its exact truncated conditional (Geweke 1991), which leave the truncated Gaussian invariant.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.inference.distributions.normal import between, log_interval

TRIES, CANDIDATES, SWEEPS = 20, 64, 10


def sample_truncated(
    mean: Float[Tensor, "N P"], scale_tril: Float[Tensor, "N P P"], generator: torch.Generator | None = None
) -> Float[Tensor, "N P"]:
    """One draw of each row's N(mean, L L^T) given that it lies in [0, 1]^P."""
    if mean.shape[-1] == 1:
        return _interval(mean, scale_tril[..., 0], generator)
    result = torch.empty_like(mean)
    left = torch.arange(len(mean), device=mean.device)
    for _ in range(TRIES):
        if not len(left):
            return result
        noise = _randn_like(mean[left], generator)
        z = mean[left] + (scale_tril[left] @ noise.unsqueeze(-1)).squeeze(-1)
        inside = ((z >= 0) & (z <= 1)).all(-1)
        result[left[inside]] = z[inside]
        left = left[~inside]
    if len(left):
        start = _resampled(mean[left], scale_tril[left], generator)
        result[left] = _gibbs(start, mean[left], scale_tril[left], generator)
    return result


def _interval(mean: Tensor, scale: Tensor, generator: torch.Generator | None) -> Tensor:
    z = mean + scale * between(-mean / scale, (1 - mean) / scale, _rand(mean.shape, mean, generator))
    return z.clamp(0, 1)


def _resampled(mean: Tensor, scale_tril: Tensor, generator: torch.Generator | None) -> Tensor:
    rows, size = mean.shape
    mean, scale_tril = mean.unsqueeze(1), scale_tril.unsqueeze(1)
    w = _rand((rows, CANDIDATES, size), mean, generator)
    z = mean.new_zeros(rows, CANDIDATES, 0)
    x = mean.new_zeros(rows, CANDIDATES, 0)
    log_weight = mean.new_zeros(rows, CANDIDATES)
    for j in range(size):
        shift = mean[..., j] + (scale_tril[..., j, :j] * z).sum(-1)
        scale = scale_tril[..., j, j].expand_as(shift)
        a, b = -shift / scale, (1 - shift) / scale
        log_weight = log_weight + log_interval(a, b)
        z_j = between(a, b, w[..., j])
        z = torch.cat([z, z_j.unsqueeze(-1)], -1)
        x = torch.cat([x, (shift + scale * z_j).unsqueeze(-1)], -1)
    chosen = choose(log_weight, 1, generator).squeeze(1)
    return x[torch.arange(rows, device=mean.device), chosen].clamp(0, 1)


def _gibbs(x: Tensor, mean: Tensor, scale_tril: Tensor, generator: torch.Generator | None) -> Tensor:
    # In double precision: the precision matrix of a needle-like Gaussian is badly conditioned.
    wide, centre = x.double(), mean.double()
    precision = torch.cholesky_inverse(scale_tril.double())
    size = x.shape[-1]
    for _ in range(SWEEPS):
        for j in range(size):
            others = [i for i in range(size) if i != j]
            pull = (precision[:, j, others] * (wide[:, others] - centre[:, others])).sum(-1)
            location = centre[:, j] - pull / precision[:, j, j]
            scale = precision[:, j, j].rsqrt()
            w = _rand(location.shape, location, generator)
            column = location + scale * between(-location / scale, (1 - location) / scale, w)
            wide[:, j] = column.clamp(0, 1)
    return wide.to(x)


def choose(log_weight: Float[Tensor, "N K"], count: int, generator: torch.Generator | None) -> Int[Tensor, "N count"]:
    """Indices drawn in proportion to exp(log_weight), on the generator's device first and then on the weights'."""
    weight = log_weight.softmax(-1)
    weight = weight.to(generator.device) if generator is not None else weight
    return torch.multinomial(weight, count, replacement=True, generator=generator).to(log_weight.device)


def _rand(shape: tuple[int, ...] | torch.Size, like: Tensor, generator: torch.Generator | None) -> Tensor:
    """Uniform in the open interval (0, 1)."""
    device = generator.device if generator is not None else like.device
    tiny = torch.finfo(like.dtype).eps
    return torch.rand(shape, dtype=like.dtype, device=device, generator=generator).clamp(tiny, 1 - tiny).to(like.device)


def _randn_like(like: Tensor, generator: torch.Generator | None) -> Tensor:
    device = generator.device if generator is not None else like.device
    return torch.randn(like.shape, dtype=like.dtype, device=device, generator=generator).to(like.device)
