"""The parameters, ratios and products that the data tell something about, from draws, in words.

    s_i^2 = 12 Var(z_i)        share of the prior's variance that parameter i keeps; z: coordinates of its box
    l_i = log theta_i          where its bounds are positive, else theta_i
    y_i = l_i / sd(l_i),       R = Cov(y) = V diag(m) V'
    m_k << 1                   v_k . y is known far better than its parameters alone would tell
    c . y                      prod_i theta_i^(e_i),   e_i = c_i / sd(l_i)

A parameter is known where it keeps less than half of the prior's standard deviation. A combination is known where it
keeps half (a third, if all its parameters are known anyway) of the one it would have were they independent. Of those
with small whole exponents of two or three parameters the simplest is taken that is nearly as sharp as the sharpest;
where none comes near the eigenvector of R, its own exponents are given to a tenth. This is the analysis of sloppy
directions (Gutenkunst et al. 2007) by a covariance, read in words. A variance knows nothing of modes: a posterior of
two far peaks is as wide as its prior.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, product

import torch
from jaxtyping import Float
from torch import Tensor

from onlinebayes.inference.base import Belief
from onlinebayes.inference.distributions import Box, BoxUniform
from onlinebayes.parameters import ParameterSpace

KNOWN = 0.25
"""Share of a variance: half of a standard deviation."""

NEWS = 0.1
"""The same for combinations of known parameters: three times as narrow as these alone would make it."""

NEARLY = 4.0
"""Ratio of variances: whole exponents may double the standard deviation of the sharpest combination."""

EXPONENTS = {2: 3, 3: 2}
"""Of how many parameters, and up to which exponent."""

WIDE = 0.8
"""Share of the prior's standard deviation that is called about as wide: a ridge across the box leaves .87 of it."""

LEAST = 0.1
"""Share of an eigenvector's largest entry below which a parameter has no part in it."""


@dataclass(frozen=True)
class Combination:
    """A parameter, or several taken together.

    Attributes:
        exponents: of each parameter with a part in it (factors, where it is a sum).
        words: ``"mass/length"``.
        width: its standard deviation, as a share of the prior's; of the logarithm for ratios and products.
    """

    exponents: dict[str, float]
    words: str
    width: float


@dataclass(frozen=True)
class Identifiability:
    """The share of its prior width that a posterior leaves to each parameter, and the combinations that it knows.

    Attributes:
        parameters: standard deviation of each, as a share of the prior's.
        known: names of those that are known by themselves.
        combinations: that are known, and say more than these do; the sharpest first.
    """

    parameters: dict[str, float]
    known: tuple[str, ...]
    combinations: tuple[Combination, ...]

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the others."""
        return tuple(name for name in self.parameters if name not in self.known)

    def __str__(self) -> str:
        """One or two sentences."""
        known = [(name, self.parameters[name]) for name in self.known]
        known += [(each.words, each.width) for each in self.combinations]
        if not known:
            return f"{'Nothing' if min(self.parameters.values()) > WIDE else 'Little'} is known: {self._left()}."
        verb = "is" if len(known) == 1 else "are"
        shares = ", ".join(f"{words} ({_percent(width)})" for words, width in known)
        said = f"{'Only ' if self.unknown else ''}{_and([words for words, _ in known])} {verb} known"
        return f"{said}; left of the prior's width: {shares}.{f' {self._left()}.' if self.unknown else ''}"

    def _left(self) -> str:
        """Describe how wide the unknown ones are."""
        names, widths = self.unknown, [self.parameters[name] for name in self.unknown]
        one, within = len(names) == 1, {name for each in self.combinations for name in each.exponents}
        subject = _and(names) + (" alone" if set(names) <= within else "")
        if min(widths) > WIDE:
            return f"{subject} {'is' if one else 'are'} about as wide as the prior"
        return f"{subject} {'keeps' if one else 'keep'} {_and([_percent(w) for w in widths])} of the prior's width"


def identifiability(belief: Belief, prior: Box, *, samples: int = 10_000) -> Identifiability:
    """Measure how far a belief determines its parameters and their combinations.

    Args:
        belief: any that can be drawn from.
        prior: the box that the prior is uniform on: ``BoxUniform(space).box``, or a round's proposal's.
        samples: draws, with a fixed seed; the error of a share of variance is sqrt(2 / samples).
    """
    space = belief.space
    theta = belief.sample((samples,), torch.Generator().manual_seed(0)).double().cpu()
    before = BoxUniform(space, prior).sample((samples,), torch.Generator().manual_seed(0)).double().cpu()
    share = 12 * prior.to_frame(theta).var(0)
    known = (share < KNOWN).tolist()
    names = tuple(name for name, alone in zip(space.names, known, strict=True) if alone)
    widths = dict(zip(space.names, share.sqrt().tolist(), strict=True))
    found = _together(_coordinates(space, theta), _coordinates(space, before), known, space)
    return Identifiability(widths, names, tuple(sorted(found, key=lambda each: each.width)))


def _coordinates(space: ParameterSpace, theta: Float[Tensor, "N P"]) -> Float[Tensor, "N P"]:
    """l."""
    positive = space.low > 0
    return torch.where(positive, torch.where(positive, theta, torch.ones_like(theta)).log(), theta)


def _together(
    after: Float[Tensor, "N P"], before: Float[Tensor, "N P"], known: list[bool], space: ParameterSpace
) -> list[Combination]:
    """Combinations, one for each direction of y that is news."""
    sd = after.std(0).clamp_min(1e-300)
    R = (after / sd).T.cov().reshape(len(space), len(space))
    exponents = _whole_exponents(space)
    unit = torch.nn.functional.normalize(exponents * sd, dim=-1)
    plain, limit = exponents.abs().sum(-1), _limits(exponents != 0, known)
    free, found = torch.eye(len(space)).double(), list[Combination]()
    for _ in range(len(space)):
        # Within what the combinations found so far leave open.
        inside = torch.linalg.qr(free.T).Q if len(free) else free.T
        m, v = torch.linalg.eigh(inside.T @ R @ inside)
        sharpest, variance = inside @ v[:, 0], max(float(m[0]), 1e-12)
        part = sharpest.abs() > LEAST * sharpest.abs().max()
        if len(space) < 2 or int(part.sum()) < 2 or variance > float(_limits(part[None], known)):
            break
        own = torch.einsum("ci,ij,cj->c", unit, R, unit)
        # At least half of it has to be new.
        fresh = (unit @ inside).norm(dim=-1) > 0.5**0.5
        good = fresh & (own <= limit) & (own <= NEARLY * variance)
        if bool(good.any()):
            chosen = int(torch.where(good, plain + own / own.max(), torch.inf).argmin())
            e, direction = exponents[chosen], unit[chosen]
        else:
            e, direction = _to_a_tenth(sharpest * part / sd), sharpest
        if int(e.count_nonzero()) > 1:  # one that is left alone by rounding is said among the parameters
            width = float((after @ e).std() / (before @ e).std())
            found.append(Combination(_named(space, e), _words(space, e), width))
        free = _without(inside, direction)
        if not free.shape[0]:
            break
    return found


def _limits(part: Tensor, known: list[bool]) -> Float[Tensor, " C"]:
    """Share of the variance that a combination of these parameters may keep and still be known."""
    return torch.where((part & ~torch.tensor(known)).any(-1), KNOWN, NEWS).double()


def _without(inside: Float[Tensor, "P K"], direction: Float[Tensor, " P"]) -> Float[Tensor, "K1 P"]:
    """A basis, in rows, of what is orthogonal to the direction within a subspace."""
    along = torch.nn.functional.normalize(inside.T @ direction, dim=0)
    _, _, rows = torch.linalg.svd(along[None])
    return rows[1:] @ inside.T


def _whole_exponents(space: ParameterSpace) -> Float[Tensor, "C P"]:
    """All combinations of few parameters with small whole exponents, the first one positive, none a power of another.

    Parameters go together that count in logarithms, or that have a unit in common.
    """
    kinds = ["log" if parameter.low > 0 else parameter.unit for parameter in space.values()]
    rows = [torch.zeros(0, len(space)).double()]
    for size, most in EXPONENTS.items():
        table = torch.tensor(list(_coprime(size, most))).double()
        for members in combinations(range(len(space)), size):
            if len({kinds[i] for i in members}) == 1:
                row = torch.zeros(len(table), len(space)).double()
                row[:, list(members)] = table
                rows.append(row)
    return torch.cat(rows)


def _coprime(size: int, most: int) -> Iterator[tuple[int, ...]]:
    signed = [k for k in range(-most, most + 1) if k]
    for rest in product(range(1, most + 1), *[signed] * (size - 1)):
        if math.gcd(*rest) == 1:
            yield rest


def _to_a_tenth(exponents: Float[Tensor, " P"]) -> Float[Tensor, " P"]:
    largest = exponents[exponents.abs().argmax()]
    return (10 * exponents / largest).round() / 10


def _named(space: ParameterSpace, exponents: Tensor) -> dict[str, float]:
    return {name: e for name, e in zip(space.names, exponents.tolist(), strict=True) if e}


def _words(space: ParameterSpace, exponents: Float[Tensor, " P"]) -> str:
    """``mass/length``, ``a - 2 b``; where units and logarithms would mix, the names alone."""
    named = _named(space, exponents)
    logarithmic = {space[name].low > 0 for name in named}
    if len(logarithmic) > 1 or (logarithmic == {False} and len({space[name].unit for name in named}) > 1):
        return f"a combination of {_and(list(named))}"
    if logarithmic == {False}:
        terms = [f"{'-' if e < 0 else '+'} {'' if abs(e) == 1 else f'{abs(e):g} '}{name}" for name, e in named.items()]
        return " ".join(terms).removeprefix("+ ")
    above, below = ([_power(name, abs(e)) for name, e in named.items() if (e > 0) == up] for up in (True, False))
    divisor = f"({' * '.join(below)})" if len(below) > 1 else "".join(below)
    return f"{' * '.join(above) or '1'}{'/' if below else ''}{divisor}"


def _power(name: str, exponent: float) -> str:
    return name if exponent == 1 else f"{name}^{exponent:g}"


def _and(words: list[str] | tuple[str, ...]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %" if share > 0.1 else f"{100 * share:.2g} %"
