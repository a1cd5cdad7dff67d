"""A replay is read where the sensor was: exactly for a parabola, at the edges too."""

import pytest
import torch

from onlinebayes.identification.replaying.instants import read_late


def parabola(place: torch.Tensor) -> torch.Tensor:
    return 2.0 - 3.0 * place + 0.7 * place**2


def test_a_parabola_is_read_exactly() -> None:
    place = torch.arange(9, dtype=torch.float64).expand(2, 1, 9).mT  # (W, K, S) = (2, 9, 1)
    late = torch.rand(2, 9, 1, generator=torch.Generator().manual_seed(0), dtype=torch.float64) - 0.5
    assert torch.allclose(read_late(parabola(place)[None], late)[0], parabola(place + late))


@pytest.mark.parametrize("rows", [1, 2])
def test_too_few_rows_for_a_parabola_are_read_as_they_are(rows: int) -> None:
    signals = torch.arange(rows, dtype=torch.float64)[None, None, :, None]
    assert torch.equal(read_late(signals, torch.full((1, rows, 1), 0.3)), signals)
