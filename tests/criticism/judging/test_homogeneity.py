import pytest
import torch

from onlinebayes.criticism.judging.homogeneity import agree, between_sd


def parts(sizes: list[float], weight: float = 100.0) -> tuple[torch.Tensor, torch.Tensor]:
    """(cross, square) of parts in which the effect has these sizes, 1 being the fitted one."""
    square = torch.full((len(sizes),), weight, dtype=torch.float64)
    return (torch.tensor(sizes, dtype=torch.float64) - 1) * square, square


@pytest.mark.parametrize(
    ("sizes", "same"),
    [
        ([1.0, 1.1, 0.9, 1.0, 1.0], True),
        ([1.0, 1.1, 0.9, 1.0, -1.0], False),  # 80 % share the sign, but the spread is .85
        ([2.0, 2.0, 2.0, 0.1, 0.1], False),
        ([1.4, 0.6, 1.4, 0.6, 1.0], True),
        ([3.0, -1.0], False),
    ],
)
def test_one_law_or_a_patch(sizes: list[float], same: bool) -> None:
    cross, square = parts(sizes)
    assert agree(cross, square, 1.0) == same


def test_parts_that_know_nothing_do_not_vote() -> None:
    cross, square = parts([1.0, 1.05, 0.95, -8.0])
    square[3] = 0.5  # se 1.4, more than half of the size
    cross[3] = -9.0 * 0.5
    assert agree(cross, square, 1.0)


def test_noise_between_parts_is_not_spread() -> None:
    # Sizes scattered by exactly their own standard error: DerSimonian and Laird find nothing, most of the time.
    draw = torch.Generator().manual_seed(1)
    passed = 0
    for _ in range(200):
        cross, square = parts((1 + 0.3 * torch.randn(8, generator=draw, dtype=torch.float64)).tolist(), weight=1 / 0.09)
        passed += agree(cross, square, 1.0)
    assert passed >= 190


def test_between_sd_of_a_worked_example() -> None:
    # Sizes 1 and 3, equal variances 1: Q = 2, c = 1, tau^2 = (2 - 1) / 1.
    alpha, w = torch.tensor([1.0, 3.0]).double(), torch.ones(2).double()
    assert between_sd(alpha, w) == pytest.approx(1.0)
    assert between_sd(torch.tensor([1.0, 1.1]).double(), w) == 0.0
