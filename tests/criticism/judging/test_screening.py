"""The flip test on synthetic rows: its level, its power, its sides, and what it does not rank."""

import pytest
import torch
from scipy.stats import binom

from onlinebayes.criticism.judging.screening import Column, block_scores, observed, p_values, stepped_down
from onlinebayes.identification.fitting.projection import Projected

B, PER, M, P = 8, 3, 20, 2
V = B * PER
OF = torch.arange(V) // PER


def rows(residual: torch.Tensor, columns: torch.Tensor) -> Projected:
    nothing = torch.zeros(V, M, 0, dtype=torch.float64)
    ones = torch.ones(V, M, dtype=torch.float64)
    triangle = torch.zeros(V, 0, 0, dtype=torch.float64)
    return Projected(residual, columns, torch.ones(1, dtype=torch.float64), ones, nothing, triangle, M, 1)


def correlated(draw: torch.Generator, *shape: int) -> torch.Tensor:
    """Rows that are correlated within windows and share a sign of their own: what flips of blocks must bear."""
    noise = torch.randn(*shape, generator=draw, dtype=torch.float64)
    return noise.cumsum(-1) / M**0.5


def test_p_is_uniform_under_an_exchangeable_null() -> None:
    draw, tests = torch.Generator().manual_seed(3), [Column(0, True), Column(1, False), Column(2, True)]
    columns = correlated(draw, P, V, M).movedim(0, -1)
    candidates = correlated(draw, 3, V, M).movedim(0, -1)
    smallest = []
    for _ in range(400):
        projected = rows(correlated(draw, V, M), columns)
        _, p, _ = p_values([block_scores(projected, candidates, OF, B)], tests, 3)
        smallest.append(float(p.min()))
    # Over the family the smallest p is below .05 in one null set of twenty: 400 sets, false failure below 1e-4.
    hits = sum(p <= 0.05 for p in smallest)
    low, high = binom.ppf([5e-5, 1 - 5e-5], 400, 0.05)
    assert low <= hits <= high


def test_drawn_flips_stand_for_all_of_them() -> None:
    draw = torch.Generator().manual_seed(8)
    candidates = correlated(draw, 3, V, M).movedim(0, -1)
    residual = 0.25 * candidates[..., 1] + correlated(draw, V, M)
    none = torch.zeros(V, M, 0, dtype=torch.float64)
    tests = [Column(0, True), Column(1, True), Column(2, True)]

    def p_of(groups: int) -> torch.Tensor:
        of = torch.arange(V) * groups // V
        return p_values([block_scores(rows(residual, none), candidates, of, groups)], tests, 3)[1]

    drawn = p_of(V)  # 24 groups: 4096 of 16 million flips
    assert float(drawn.min()) >= 1 / 4096
    # Flips of pairs of windows are all taken; the two tests agree as far as pairs and single windows do.
    assert torch.allclose(drawn, p_of(V // 2), atol=0.12)


def test_a_true_effect_is_found_and_the_others_are_not() -> None:
    draw = torch.Generator().manual_seed(4)
    columns = correlated(draw, P, V, M).movedim(0, -1)
    candidates = correlated(draw, 3, V, M).movedim(0, -1)
    residual = 2.0 * candidates[..., 1] + 0.3 * correlated(draw, V, M)
    tests = [Column(0, True), Column(1, False), Column(2, True)]
    z, p, best = p_values([block_scores(rows(residual, columns), candidates, OF, B)], tests, 3)
    assert int(z.argmax()) == 1
    assert float(p[1]) <= 2 / 2**B
    assert float(p[0]) > 0.03
    assert float(p[2]) > 0.03
    assert best.tolist() == [0, 1, 2]
    assert torch.equal(observed([block_scores(rows(residual, columns), candidates, OF, B)], tests), z)


def test_of_two_that_are_much_alike_neither_hides_the_other() -> None:
    draw = torch.Generator().manual_seed(9)
    first, aside = correlated(draw, 2, V, M)
    second = first + 0.4 * aside
    # Three of the blocks hardly show the misfit: flipped or not, they leave the first z above the second.
    shown = torch.where(torch.arange(V) < 3 * PER, 0.05, 1.0)[:, None]
    residual = shown * first
    none = torch.zeros(V, M, 0, dtype=torch.float64)
    tests = [Column(0, False), Column(1, False)]
    scores = block_scores(rows(residual, none), torch.stack([first, second], -1), OF, B)
    z, p, _ = p_values([scores], tests, 2)
    assert z[0] > z[1]
    assert p.tolist() == [1 / 2**B, 1 / 2**B]
    flipped = ((torch.cartesian_prod(*[torch.tensor([1.0, -1.0]).double()] * B) @ scores.g) / scores.norm.sqrt()).amax(
        1
    )
    beyond = flipped >= scores.g.sum(0)[1] / scores.norm[1].sqrt()
    assert float(beyond.double().mean()) > 0.03  # of the maximum over both


def test_no_p_lies_below_that_of_a_higher_rank() -> None:
    draw = torch.Generator().manual_seed(10)
    flipped = torch.randn(256, 6, generator=draw, dtype=torch.float64)
    z = flipped[0] + torch.tensor([0.0, 1.0, 2.0, 0.5, 0.0, 3.0], dtype=torch.float64)
    p = stepped_down(z, flipped)
    ranked = p[z.argsort(descending=True)]
    assert bool((ranked.diff() >= 0).all())
    assert float(ranked[0]) == float((flipped.amax(1) >= z.max()).double().mean())
    assert bool((p <= (flipped.amax(1)[None] >= z[:, None]).double().mean(1)).all())


@pytest.mark.parametrize(("two_sided", "found"), [(True, True), (False, False)])
def test_a_bounded_effect_counts_on_its_own_side_only(two_sided: bool, found: bool) -> None:
    draw = torch.Generator().manual_seed(5)
    candidates = correlated(draw, 1, V, M).movedim(0, -1)
    residual = -2.0 * candidates[..., 0] + 0.3 * correlated(draw, V, M)
    scores = block_scores(rows(residual, torch.zeros(V, M, 0, dtype=torch.float64)), candidates, OF, B)
    _, p, _ = p_values([scores], [Column(0, two_sided)], 1)
    assert (float(p[0]) < 0.03) == found


def test_what_the_fitted_parameters_do_already_is_not_ranked() -> None:
    draw = torch.Generator().manual_seed(6)
    columns = correlated(draw, P, V, M).movedim(0, -1)
    same = (3.0 * columns[..., 0] - columns[..., 1])[..., None]
    other = correlated(draw, 1, V, M).movedim(0, -1)
    scores = block_scores(rows(correlated(draw, V, M), columns), torch.cat([same, other], -1), OF, B)
    _, _, best = p_values([scores], [Column(0, True), Column(1, True)], 2)
    assert best.tolist() == [-1, 1]


def test_the_best_starting_value_speaks_for_its_candidate() -> None:
    draw = torch.Generator().manual_seed(7)
    candidates = correlated(draw, 3, V, M).movedim(0, -1)
    residual = candidates[..., 2] + 0.3 * correlated(draw, V, M)
    scores = block_scores(rows(residual, torch.zeros(V, M, 0, dtype=torch.float64)), candidates, OF, B)
    _, p, best = p_values([scores], [Column(0, True), Column(1, True), Column(1, True)], 2)
    assert best.tolist()[1] == 2
    assert float(p[1]) < 0.03
    assert float(scores.size[2]) == pytest.approx(1.0, abs=0.2)


def test_the_size_is_least_squares() -> None:
    draw = torch.Generator().manual_seed(8)
    columns, candidates = correlated(draw, P, V, M).movedim(0, -1), correlated(draw, 1, V, M).movedim(0, -1)
    residual = correlated(draw, V, M)
    scores = block_scores(rows(residual, columns), candidates, OF, B)
    every = torch.cat([columns, candidates], -1).flatten(0, 1)
    joint = torch.linalg.lstsq(every, residual.flatten()[:, None]).solution[-1, 0]
    assert float(scores.size[0]) == pytest.approx(float(joint))
