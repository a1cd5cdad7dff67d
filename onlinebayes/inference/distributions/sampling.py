"""Draws from Gaussians truncated to the unit cube: inside always, and never an endless loop.

Plain rejection first (exact; most components lie mostly inside), a bounded number of tries. Rows still outside are
drawn by inverting the distribution function where P = 1; otherwise they take a start from Genz's separation of
variables, importance-resampled (exact as the number of candidates grows), and then sweeps of Gibbs sampling, each
coordinate from its exact truncated conditional (Geweke 1991), which leave the truncated Gaussian invariant.
"""

from __future__ import annotations

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

from onlinebayes.inference.distributions.normal import between, log_interval

TRIES, CANDIDATES, SWEEPS = 20, 64, 10
FEW = 16
"""Weights up to which comparing with all of them is faster than a search."""
SPARE = 16
"""Draws more than the share asks for, so that the last few come at once."""


def sample_truncated(
    mean: Float[Tensor, "N P"], scale_tril: Float[Tensor, "N P P"], generator: torch.Generator | None = None
) -> Float[Tensor, "N P"]:
    """One draw of each row's N(mean, L L^T) given that it lies in [0, 1]^P."""
    result = _drawn(mean, scale_tril, generator)
    left = _outside(result)
    for _ in range(TRIES - 1):
        if not len(left):
            return result
        result[left] = z = _drawn(mean[left], scale_tril[left], generator)
        left = left[_outside(z)]
    if len(left):
        mean, scale_tril = mean[left], scale_tril[left]
        if mean.shape[-1] == 1:
            result[left] = _interval(mean, scale_tril[..., 0], generator)
        else:
            start = _resampled(mean, scale_tril, generator)
            result[left] = _gibbs(start, mean, scale_tril, generator)
    return result


def _drawn(mean: Tensor, scale_tril: Tensor, generator: torch.Generator | None) -> Tensor:
    """N(mean, L L^T), the product written out: a million small matrices are slower through a solver's calls."""
    noise = _randn(mean.T, generator)
    columns = list(mean.unbind(-1))
    for i, row in enumerate(scale_tril.unbind(-2)):
        for factor, x in zip(row.unbind(-1)[: i + 1], noise, strict=False):
            columns[i] = torch.addcmul(columns[i], factor, x)
    return torch.stack(columns).T


def _outside(z: Tensor) -> Tensor:
    """Indices of the rows outside the cube."""
    return ((z - 0.5).abs_().amax(-1) > 0.5).nonzero().squeeze(-1)


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


def sample_whole(
    weights: Float[Tensor, " K"],
    mean: Float[Tensor, "K P"],
    scale_tril: Float[Tensor, "K P P"],
    share: float,
    count: int,
    rows: int,
    generator: torch.Generator | None = None,
) -> Float[Tensor, "N P"]:
    """Draws of sum_k w_k N(mu_k, L_k L_k^T) given that they lie in [0, 1]^P; those outside are drawn again.

    A million draws of two parameters cost little more than their random numbers: everything is done column by column,
    in pieces that stay in the processor's cache, and the result lies so in memory.

    Args:
        weights, mean, scale_tril: of the components.
        share: probability of the cube, well above zero.
        count: number of draws N.
        rows: draws made together.
    """
    result = torch.empty(mean.shape[1], count, dtype=mean.dtype, device=mean.device)
    left = []
    for begin in range(0, count, rows):
        z = result[:, begin : begin + rows]
        _draw(z, weights, mean, scale_tril, generator)
        left.append(_outside(z.T) + begin)
    missing = torch.cat(left) if left else torch.empty(0, dtype=torch.long)
    while len(missing):
        z = result.new_empty(mean.shape[1], min(math.ceil(len(missing) / share) + SPARE, rows))
        _draw(z, weights, mean, scale_tril, generator)
        z = z[:, ((z - 0.5).abs_().amax(0) <= 0.5)][:, : len(missing)]
        result[:, missing[: z.shape[1]]] = z
        missing = missing[z.shape[1] :]
    return result.T


def _draw(
    z: Float[Tensor, "P N"], weights: Tensor, mean: Tensor, scale_tril: Tensor, generator: torch.Generator | None
) -> None:
    """Fill z with draws of the whole mixture."""
    chosen, noise = _pick(weights, z.shape[1], generator), _randn(z, generator)
    for i, column in enumerate(z):
        torch.index_select(mean[:, i], 0, chosen, out=column)
        for j in range(i + 1):
            column.addcmul_(scale_tril[:, i, j].index_select(0, chosen), noise[j])


def _pick(weights: Tensor, count: int, generator: torch.Generator | None) -> Tensor:
    """Indices drawn in proportion to weights (K,) of sum one, by inverting their distribution function."""
    device = generator.device if generator is not None else weights.device
    u = torch.rand(count, device=device, generator=generator).to(weights.device)
    edges = weights.cumsum(0)[:-1].float()
    if len(weights) > FEW:
        return torch.bucketize(u, edges, right=True, out_int32=True)
    index = torch.zeros(count, dtype=torch.uint8, device=weights.device)
    for edge in edges:
        index += (u >= edge).view(torch.uint8)
    return index.int()


def _rand(shape: tuple[int, ...] | torch.Size, like: Tensor, generator: torch.Generator | None) -> Tensor:
    """Uniform in the open interval (0, 1)."""
    device = generator.device if generator is not None else like.device
    tiny = torch.finfo(like.dtype).eps
    return torch.rand(shape, dtype=like.dtype, device=device, generator=generator).clamp(tiny, 1 - tiny).to(like.device)


def _randn(like: Tensor, generator: torch.Generator | None) -> Tensor:
    """Standard normal numbers, drawn in single precision: five times as fast, and no draw is told from a double's."""
    device = generator.device if generator is not None else like.device
    return torch.randn(like.shape, device=device, generator=generator).to(like)
